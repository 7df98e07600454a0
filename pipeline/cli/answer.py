"""A run's answer on a terminal: which way and how sure, the best way on each side, and doubts."""

import re
import textwrap
from collections.abc import Iterator, Sequence

from pipeline.cli.terminal import table, wrapped
from pipeline.findings import text
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import DEAR, RankedRoute, RunCase
from pipeline.findings.sentences import case_facts
from pipeline.model import Note
from pipeline.model.inputs import KINDS
from pipeline.run import Outcome

# Difference of fuel from still water, as a share, below which it counts as none.
_AS_IN_STILL = 5e-3
# If the longest route is shorter than this, lengths are in metres, not kilometres.
_SHORT_M = 10_000.0
_NAUTICAL_MILE_M = 1852.0
_ANSWERS, _PLAIN, _USED, _OWN_LINE = (
    frozenset(KINDS[group]) for group in ("answers", "plain", "used", "own_line")
)
_LEAVE = re.compile(r"^Leave at [^:]+:\d\d(:\d\d)? UTC: ")
_RANKS = re.compile(r"\b[Rr]outes? (\d+(?:, \d+)*)")
_SENTENCE_END = re.compile(r"(?<=\.) (?=[A-Z])")
# Where a doubt may end on its line: before what follows.
_CLAUSE = re.compile(r"[;:,.] | \(")
# Largest number of lines without `--verbose`, two of which say where the files are.
_LINES = 20
# Least number of doubts that are printed; the others are counted.
_DOUBTS = 3


def answer(outcome: Outcome, width: int | None = None, *, verbose: bool = False) -> str:
    """Return the text that a run prints.

    First the title, which says the places of a voyage as they were read; the way to take in each
    case, then why, and how sure that is; then a table with the best route on each side of the main
    island, without sides that are much dearer; then a line for each doubt, as many as fit. With
    `verbose` doubts are whole, and reasons, choices and places follow. Lines are broken at `width`,
    in characters, if it is given.
    """
    result = outcome.result
    ways = [list(_way(case, outcome)) for case in result.cases]
    lines = [outcome.scenario.title or outcome.scenario.name, *(way[0] for way in ways)]
    lines += [line.removesuffix(".") for way in ways for line in way[1:]]
    told = [note for note in dict.fromkeys(result.choices) if note.kind in _ANSWERS]
    # The first sentence answers the question, and the others are reasons; the hour stands above.
    firsts = [_LEAVE.sub("", _SENTENCE_END.split(line)[0]) for line in note_texts(told)]
    lines += [f"  {text.capitalised(line).removesuffix('.')}." for line in firsts]
    lines = wrapped("\n".join(lines), width).splitlines()
    lines += ["", *_sides(outcome, width)]
    shown = {str(one.rank) for case in result.cases for one in _listed(case)}

    def found_in(match: re.Match[str]) -> str:
        return match[0] + " (see report.html)" * (not {*match[1].split(", ")} <= shown)

    doubts = [f"! {_RANKS.sub(found_in, text.capitalised(one))}" for one in _doubts(outcome)]
    if not verbose:
        most = max(_DOUBTS, _LINES - 3 - len(lines))
        if len(doubts) > most:
            doubts[most - 1 :] = [f"! And {len(doubts) - most + 1} more doubts: add --verbose"]
        doubts = [_one_line(doubt, width) for doubt in doubts]
    lines += [""] * bool(doubts) + wrapped("\n".join(doubts), width).splitlines()
    if verbose:
        lines += wrapped("\n".join(_details(outcome)), width).splitlines()
    return "\n".join(lines)


def _one_line(doubt: str, width: int | None) -> str:
    """Return a doubt as far as it fits a line, to the end of a clause if it is long enough."""
    if width is None or len(doubt) <= width:
        return doubt
    short = textwrap.shorten(doubt, width, placeholder=" …")
    ends = [found.start() for found in _CLAUSE.finditer(short)]
    return f"{short[: ends[-1]]} …" if ends and ends[-1] > width // 2 else short


def _way(case: RunCase, outcome: Outcome) -> Iterator[str]:
    """Yield a case's answer: the way and its figures, its times, the reason, and how sure it is."""
    about = f"{text.season_name(case.name)}: " if len(outcome.result.cases) > 1 else ""
    facts = case_facts(case)
    if facts is None:
        yield text.capitalised(f"{about}no route: {case.result.failure}")
        return
    best = facts.best
    parts = [text.distance(best.length_m)]
    if best.length_m >= _SHORT_M:
        miles = text.number(best.length_m / _NAUTICAL_MILE_M, 3)
        parts[0] = f"{text.number(best.length_m / 1000, 3)} km ({miles} NM)"
    parts += [text.days(best.duration_s) or text.hours(best.duration_s), _fuel(case.routes[0])]
    direction, _, rest = best.main_passage.partition(" ")
    go = f"go {direction.upper()} {rest}" if rest else "the best route"
    yield text.capitalised(f"{about}{go}, {', '.join(parts)}")
    passage = outcome.scenario.passage(case.name, round(best.duration_s))
    if passage is not None:
        leave, arrive = text.exact_moment_text(passage[0]), text.moment_text(passage[1])
        yield f"  {about}Leave at {leave}, arrive at {arrive}."
    yield f"  {about}{facts.because()}"
    if certain := facts.certainty():
        yield f"  {about and '  '}{certain}"


def _fuel(ranked: RankedRoute) -> str:
    """Say a route's energy and what is left, or the share of the fuel in still water."""
    row = ranked.metrics
    if row.energy is not None:
        left = f", {text.fuel(row.left, row)} left" if row.left > 0 else ""
        return f"{text.fuel(row.fuel, row)}{left}"
    share = row.fuel / row.still_fuel
    is_alike = abs(share - 1) < _AS_IN_STILL
    return f"fuel {'as in' if is_alike else f'{100 * share:.0f} % of'} still water"


def _sides(outcome: Outcome, width: int | None) -> list[str]:
    """Return the table of the best route on each side, and how many much dearer ones it omits."""
    longest_m = max((one.metrics.length_m for one in outcome.result.routes), default=0.0)
    unit = (1.0, "m") if longest_m < _SHORT_M else (1000.0, "km")
    several = len(outcome.result.cases) > 1
    rows: list[tuple[str, ...]] = [
        ("season", "way", "fuel", "length", "time", "clear", "gap", "route")
    ]
    dear = 0
    for case in outcome.result.cases:
        listed = _listed(case)
        rows += [_row(ranked, unit) for ranked in listed]
        dear += len({one.metrics.main_passage for one in case.routes}) - len(listed)
    left = 2 if several else 1
    lines = table([row if several else row[1:] for row in rows], left, width)
    if dear:
        lines.append(f"{text.count(dear, 'side', 'sides')} more, at least {DEAR:.0%} dearer")
    return lines


def _listed(case: RunCase) -> list[RankedRoute]:
    """Return the best route on each side of a case, without sides that are much dearer."""
    first = {one.metrics.main_passage: one for one in reversed(case.routes)}
    best = sorted(first.values(), key=lambda one: one.rank)
    return [one for one in best if not case.is_dear(one.metrics)]


def _row(ranked: RankedRoute, unit: tuple[float, str]) -> tuple[str, ...]:
    """Return one route's cells; fuel is above the case's best."""
    row, case = ranked.metrics, ranked.case
    more = row.fuel / case.routes[0].metrics.fuel - 1
    return (
        text.season_name(case.name),
        row.main_passage or "-",
        "best" if row.rank == 1 else f"{100 * more:+.1f} %",
        f"{text.number(row.length_m / unit[0], 4)} {unit[1]}",
        text.days(row.duration_s) or text.hours(row.duration_s),
        text.clearance(row.clearance_m) if row.has_land else "-",
        case.gap_figure(row),
        str(row.rank),
    )


def _doubts(outcome: Outcome) -> Iterator[str]:
    """Yield what a reader should doubt, the gravest first: one line each."""
    result = outcome.result
    crossed = _crossed(outcome)
    over = {one.rank for case in result.cases for one in case.measures.shore_crossings}
    if 1 in over:
        places = (line.rpartition(": ")[2] for line in note_texts(crossed))
        yield from (f"OVER LAND of another shoreline: {line}" for line in places)
    yield from (f"NARROW: {line}" for line in note_texts(result.narrow_notes))
    for case in result.cases:
        met = [one.metrics for one in case.routes if one.rank == 1 and one.metrics.collisions]
        yield from (text.turns_text(row) for row in met if not case.narrow(1))
    yield from note_texts(note for note in result.unknowns if note.kind == "energy-short")
    lacking = [case.name for case in result.cases if case.lacks_current]
    if lacking:
        yield f"current NOT known{_of(lacking, outcome)}; nothing is proven for the real one"
    yield from _stand_ins(outcome)
    if crossed and 1 not in over:
        routes = f"route{'s' * (len(over) > 1)} {', '.join(map(str, sorted(over)))}"
        yield f"{routes}: over land of another shoreline (places: --verbose)"
    told = {*_ANSWERS, *_PLAIN, *_USED, *_OWN_LINE, *["still-water"] * bool(lacking)}
    every = dict.fromkeys((*result.decisions, *result.unknowns, *result.fetched.notes))
    yield from note_texts(note for note in every if note.kind not in told)


def _crossed(outcome: Outcome) -> list[Note]:
    """Return the notes on routes over land of another shoreline."""
    return [note for note in outcome.result.unknowns if note.kind == "second-shoreline"]


def _stand_ins(outcome: Outcome) -> Iterator[str]:
    """Yield a line for each source of currents that stands in for a preferred one."""
    found: dict[tuple[str, str], list[str]] = {}
    for case in outcome.result.cases:
        if (grid := case.grid) is None or grid.is_left_out:
            continue
        # A table that is asked for by its name may be of another year.
        is_other = grid.valid and not (grid.changes or grid.valid.startswith(case.spec.valid[:7]))
        if grid.is_stand_in or is_other:
            missed = " or ".join(name for name, _ in grid.passed_over)
            found.setdefault((grid.credit.name, missed), []).append(case.name)
    for (source, missed), names in found.items():
        cases = [outcome.result.case(name) for name in names]
        dates = " and ".join(case.period_text for case in cases)
        asked = {case.spec.valid: 0 for case in cases if case.spec.valid != case.source_grid.valid}
        other = " and ".join(filter(None, asked))
        about = _of(names, outcome) if len(names) < len(outcome.result.cases) else ""
        instead = f", not {missed} (why: --verbose)" if missed else ""
        yield f"current of {dates}{f', not {other}' * bool(other)}{about}: {source}{instead}"


def _of(names: Sequence[str], outcome: Outcome) -> str:
    """Name some of several cases."""
    if len(outcome.result.cases) == 1:
        return ""
    return f" for {' and '.join(map(text.season_name, names))}"


def _details(outcome: Outcome) -> Iterator[str]:
    """Yield what `--verbose` adds: reasons, choices, places, and turns."""
    result = outcome.result
    unused = {
        f"{name}: {reason}" for one in outcome.fetched.currents for name, reason in one.passed_over
    }
    for title, lines in (
        ("Over land of another chart:", note_texts(_crossed(outcome))),
        ("Currents NOT used:", sorted(unused)),
        ("Currents:", note_texts(note for note in result.decisions if note.kind in _USED)),
        ("Chosen:", note_texts(dict.fromkeys(result.choices))),
        ("Turns:", _turns(outcome)),
        ("Islands:", _islands(outcome)),
    ):
        listed = [f"- {line}" for line in lines]
        yield from ["", title, *listed] * bool(listed)
    rejected = sum(len(case.plan.rejected) for case in result.cases if case.plan is not None)
    reasons = f"; {text.count(rejected, 'rejected class', 'rejected classes')}, with reasons"
    routes = text.count(len(result.routes), "route", "routes")
    yield f"\nIn report.html: {routes}{reasons if rejected else ''}."


def _turns(outcome: Outcome) -> list[str]:
    """Say how many simulated hard-over turns met no-go areas, for each route."""
    return [
        f"{text.season_name(one.case.name)}, route {one.rank}: {text.turns_text(one.metrics)}"
        for one in outcome.result.routes
        if one.metrics.has_land
    ]


def _islands(outcome: Outcome) -> list[str]:
    """Say where the islands lie that the ways are named by."""
    return [
        f"{'island ' * (not island.name)}{island.label} at {island.place}"
        for island in outcome.result.islands
    ]
