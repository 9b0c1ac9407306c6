"""cwcli: from a recorded drive to states, predicted paths and collision warnings."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mcap.decoder import DecoderFactory

__version__ = "0.1.0"


def decoder_factory() -> DecoderFactory:
    """Return a factory with which the official MCAP reader decodes every message that cwcli writes.

    Protobuf becomes a message of its class, JSON what `json.loads` returns, CDR (in simulated logs and ROS exports) an
    object with the fields of the ROS message. Recorded channels in these encodings are decoded as well. One factory
    serves any number of files.

        with open("annotated.mcap", "rb") as stream:
            reader = mcap.reader.make_reader(stream, decoder_factories=[cwcli.decoder_factory()])
            for schema, channel, message, decoded in reader.iter_decoded_messages():
                ...

    Raises (while the official reader decodes):
        InputError: A schema can't be used, or a message is damaged.
    """
    from cwcli.logs.codecs.official import OfficialDecoderFactory

    return OfficialDecoderFactory()
