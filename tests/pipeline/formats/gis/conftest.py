from __future__ import annotations

from tests.pipeline.formats.exchange.conftest import any_run

__all__ = ["any_run"]
