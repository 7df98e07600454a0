"""An area of the user's that is shut: always, or for some hours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from pydantic import AwareDatetime, ConfigDict, Field, model_serializer, model_validator

from pipeline.scenario.strict import PathText, StrictModel

if TYPE_CHECKING:
    from pydantic import SerializerFunctionWrapHandler


class AvoidedArea(StrictModel):
    """Polygons of a file that no route may enter: between two times, or ever."""

    model_config = ConfigDict(populate_by_name=True)

    path: PathText = Field(
        description="File with the polygons, in lon/lat or the CRS that it states; relative paths "
        "start at the scenario's folder. Give a GeoJSON file, or another vector file.",
        examples=["./firing-range.geojson"],
    )
    begin: AwareDatetime | None = Field(
        default=None,
        alias="from",
        description="Time from which the area is shut; left out, it always was. Give a time with "
        "its zone, as 2026-07-01T09:00:00Z, or leave it out.",
        examples=["2026-07-01T09:00:00Z"],
    )
    until: AwareDatetime | None = Field(
        default=None,
        description="Time until which the area is shut; left out, it stays so. Give a time with "
        "its zone, as 2026-07-01T12:40:00Z, or leave it out.",
        examples=["2026-07-01T12:40:00Z"],
    )

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if self.begin is not None and self.until is not None and self.until <= self.begin:
            raise ValueError(
                f"is shut from {self.begin.isoformat()} until {self.until.isoformat()}, which is "
                "not later; give a later time"
            )
        return self

    @model_serializer(mode="wrap")
    def _by_its_keys(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Spell the keys as a scenario does: `from` is no name in Python."""
        return {("from" if key == "begin" else key): value for key, value in dump(self).items()}

    @property
    def has_hours(self) -> bool:
        """Whether it is open at some time."""
        return self.begin is not None or self.until is not None
