"""The period that a season's current is valid for: a month, a day or an instant, always UTC."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

# Forms of a season's `valid`; whether the date exists is checked by `datetime`.
_INSTANT = re.compile(r"\d{4}-\d{2}-\d{2}T\d{2}:\d{2}Z", re.ASCII)
_DAY = re.compile(r"\d{4}-\d{2}-\d{2}", re.ASCII)
_MONTH = re.compile(r"\d{4}-\d{2}", re.ASCII)


@dataclass(frozen=True, slots=True)
class Period:
    """The time from `begin` up to `end`, aware UTC datetimes; an instant where they are equal."""

    begin: datetime
    end: datetime

    @property
    def is_instant(self) -> bool:
        """Whether it is a single moment, without duration."""
        return self.begin == self.end


def period(valid: str) -> Period:
    """Read 'YYYY-MM', 'YYYY-MM-DD' or 'YYYY-MM-DDTHH:MMZ'; else ValueError with the remedy."""
    try:
        if _INSTANT.fullmatch(valid):
            moment = datetime.strptime(valid, "%Y-%m-%dT%H:%MZ").replace(tzinfo=UTC)
            return Period(moment, moment)
        if _DAY.fullmatch(valid):
            begin = datetime.strptime(valid, "%Y-%m-%d").replace(tzinfo=UTC)
            return Period(begin, begin + timedelta(days=1))
        if _MONTH.fullmatch(valid):
            begin = datetime.strptime(valid, "%Y-%m").replace(tzinfo=UTC)
            return Period(begin, (begin + timedelta(days=31)).replace(day=1))
        reason = "it has another form"
    except (ValueError, OverflowError) as error:
        reason = str(error)
    raise ValueError(
        f"{valid!r} is not a time ({reason}): give a month 'YYYY-MM', a day 'YYYY-MM-DD' or an "
        "instant 'YYYY-MM-DDTHH:MMZ', in UTC"
    )
