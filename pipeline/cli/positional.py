"""A command whose arguments may begin with a minus: `renew go -71.02,42.35 -70.98,42.31`."""

from __future__ import annotations

import re
from typing import Any

from typer.core import TyperCommand

# A minus and a figure: no option of ours begins so.
_NEGATIVE = re.compile(r"-[\d.]")


class NegativeFigures(TyperCommand):
    """Takes words that begin with a minus and a figure as arguments, not as options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - of click, or of typer's own copy of it
        """Parse the words; a blank before a minus hides it from the parser of options."""
        return super().parse_args(ctx, [f" {a}" if _NEGATIVE.match(a) else a for a in args])
