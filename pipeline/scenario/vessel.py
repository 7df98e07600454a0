"""The vessel of a scenario."""

from typing import Annotated

from pydantic import Field

from pipeline.scenario.strict import Name, Positive, StrictModel

# As of `renew.Vessel`: larger figures are a slip of the pen, and powers of them overflow.
_Figure = Annotated[Positive, Field(le=1e6)]
_TURN_RATE_LIMIT_DEG_S = 5e7  # 1e6 radians/s is a little more


class VesselSpec(StrictModel):
    """A vessel: speed, turn rate and fuel law. An entry of the catalogue has the same keys."""

    name: Name = Field(
        default="vessel",
        description="Name of the vessel. Use up to 64 lower-case letters, digits, '-' and '_'.",
    )
    title: str = Field(
        default="",
        description="Name of the vessel for readers. Give any text.",
        examples=["Ocean-going unmanned surface vessel, 7 m"],
    )
    origin: str = Field(
        default="",
        description="Where the vessel's figures come from. Give any text.",
        examples=["Sea trials of May 2025"],
    )
    length_m: _Figure = Field(
        description="Length overall, metres. Give the length overall in metres.", examples=[7.0]
    )
    draught_m: Positive | None = Field(
        default=None,
        description="Draught, metres; needed on charts with depths. Give the metres that the "
        "vessel reaches below the water line.",
        examples=[0.9],
    )
    speed_m_s: _Figure = Field(
        description="Speed through water, m/s, the same all the way. Give the speed through water "
        "in m/s.",
        examples=[5.0],
    )
    turn_rate_deg_s: Positive = Field(
        le=_TURN_RATE_LIMIT_DEG_S,
        description="Turn rate with the helm hard over, degrees/s. Give the hard-over turn rate "
        "in degrees/s.",
        examples=[16.5],
    )
    fuel_coefficient: Positive = Field(
        default=1.0,
        le=1e12,
        description="Factor of the fuel law: fuel per second = coefficient × speed^exponent, "
        "which sets the unit of all fuel figures. Give a number above 0.",
    )
    fuel_exponent: Positive = Field(
        default=2.0,
        le=20,
        description="Exponent of the fuel law: fuel per second = coefficient × speed^exponent. "
        "Give a number above 0, at most 20: 2 is the paper's, 3 the propeller law of displacement "
        "hulls.",
    )
