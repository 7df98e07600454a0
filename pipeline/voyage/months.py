"""Read the months of a voyage, each of which is a season of its scenario."""

import re
from collections.abc import Sequence

from pipeline.errors import RequestError
from pipeline.scenario.times import period

_MONTH = re.compile(r"\d{4}-\d{2}", re.ASCII)


def read_months(texts: Sequence[str]) -> dict[str, str]:
    """Return the title of each month 'YYYY-MM', such as "July 2024", in the order given.

    Raises
    ------
    RequestError
        The message has a line for each text that is not a month or is given twice.
    """
    titles: dict[str, str] = {}
    faults = []
    for text in texts:
        if not _MONTH.fullmatch(text):
            faults.append(f"--month {text} is not a month; give it as 'YYYY-MM', such as 2024-07")
            continue
        if text in titles:
            faults.append(f"--month {text} is given twice; leave one out")
            continue
        try:
            titles[text] = f"{period(text).begin:%B %Y}"
        except ValueError as error:
            faults.append(f"--month {error}")
    if faults:
        raise RequestError(faults)
    return titles
