"""A voyage as a person asks for it: every option as it was typed."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import RequestError
from pipeline.scenario.catalogue import VesselSpec
from pipeline.voyage.vessel_options import RANGE, VesselFigures, speed_m_s


@dataclass(frozen=True, slots=True)
class VoyageRequest:
    """A voyage as typed for `renew go`; an option that was left out is empty.

    The first half of `positions` is the start. `figures` replaces `vessel`, which may be a complete
    specification. `speeds` is a range, "4kn..9kn". See `go` for the other options.
    """

    positions: tuple[str, ...]
    vessel: str | VesselSpec = ""
    figures: VesselFigures | None = None
    months: tuple[str, ...] = ()
    currents: tuple[str, ...] = ()
    clearance: str = ""
    charts: Path | None = None
    depths: Path | None = None
    datum: str = ""
    name: str = ""
    depart: str = ""
    until: str = ""
    arrive_by: str = ""
    speeds: str = ""
    via: tuple[str, ...] = ()
    avoid: tuple[Path, ...] = ()
    havens: Path | None = None
    within: str = ""
    endurance: str = ""
    tide: tuple[str, ...] = ()
    members: str = ""

    @classmethod
    def of_options(cls, given: Mapping[str, Any]) -> "VoyageRequest":
        """Return the request of the options of `renew go`, by the names of its parameters.

        Options that are absent or None are left out; others of the command are ignored.
        """
        speed = given.get("speed") or ""
        is_choice = RANGE in speed
        texts = (
            *("vessel", "depart", "until", "arrive_by", "within", "endurance", "clearance"),
            *("datum", "name", "members"),
        )
        lists = ("positions", "currents", "via", "avoid", "tide")
        options: dict[str, Any] = {one: given.get(one) or "" for one in texts}
        options |= {one: tuple(given.get(one) or ()) for one in lists}
        return cls(
            figures=VesselFigures(
                "" if is_choice else speed,
                *(given.get(one) or "" for one in ("length", "turning_circle", "draught")),
            ),
            months=tuple(given.get("month") or ()),
            speeds=speed if is_choice else "",
            charts=given.get("charts"),
            depths=given.get("depths"),
            havens=given.get("havens"),
            **options,
        )

    @property
    def member_key(self) -> dict[str, Any]:
        """The members of a season: its files, a dimension of them, or the speed of random eddies.

        Raises RequestError for a text that is neither a name nor a speed.
        """
        given = self.members.strip()
        if not given:
            return {}
        if given.isidentifier():
            return {"members": {"along": given}}
        try:
            return {"members": {"spread": speed_m_s(given)}}
        except ValueError as error:
            raise RequestError(
                f"--members = {given!r}: {error}, 'files', or a dimension such as 'realization'"
            ) from None
