"""Text that XML can hold."""

import re

XML_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 can't write, among them lone halves of a surrogate pair."""


def xml_text(text: str) -> str:
    """Replace what XML forbids by U+FFFD; markup is left for the writer to escape."""
    return XML_FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
