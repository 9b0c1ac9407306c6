"""The registry of lane methods. To add one: write it in a file of its own and add one entry here."""

from __future__ import annotations

from cwcli.vision import zhang2011
from cwcli.vision.method import Method

METHODS: dict[str, Method] = {
    "zhang2011": Method("the paper's genetic search on 320 x 240", zhang2011.search_size, zhang2011.Zhang2011Search),
}
DEFAULT_METHOD = "zhang2011"
