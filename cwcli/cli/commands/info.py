EXAMPLES = ("cwcli info drive.mcap",)
from cwcli.cli.options.shared import LogArgument, ReadingOptions, TalkOptions


def command(log: LogArgument, reading: ReadingOptions, talk: TalkOptions) -> None:
    """List a log."""
    print(log, reading, talk)
