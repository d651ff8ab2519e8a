"""Well-posedness: existence and uniqueness of the state from every x0 (section 11.6), as one report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from flint import fmpz_poly

from pricing_core.arrays import IndexSet, Vector, check_type
from pricing_core.lcs.exosystem import Exosystem
from pricing_core.lcs.ill_posedness import IllPosedness, find_ill_posedness
from pricing_core.lcs.parts import Part, independent_parts, strongly_connected_parts
from pricing_core.lcs.passive_consequences import LARGEST_PAIRS as LARGEST_AMBIGUITY
from pricing_core.lcs.passive_consequences import ambiguous_states, has_solutions_everywhere
from pricing_core.lcs.passivity import Passivity, passivity
from pricing_core.lcs.pole_shifted_passivity import CRITERION, is_passive_after_pole_shift
from pricing_core.lcs.rational_complementarity import rational_complementarity
from pricing_core.lcs.rational_system import RationalSystem, rational_offsets, rational_system
from pricing_core.lcs.system import LCS
from pricing_core.lcs.theorems import (
    Finding,
    theorem_11_1,
    theorem_11_2,
    theorem_11_3,
    theorem_11_4,
    theorem_11_5,
    together,
)
from pricing_core.lcs.total_invertibility import (
    LARGEST_PAIRS,
    modes_of_zero_minors,
    singular_modes,
    transfer_minors,
)
from pricing_core.linalg.principal_minors import all_positive
from pricing_core.linalg.rational import as_fractions, exact_kernel, rational_array, rounded
from pricing_core.linalg.rational_definite import is_exactly_positive_definite

Verdict = Literal["well-posed", "ill-posed", "unknown"]
LARGEST_WHOLE = 6  # pairs up to which parts that do not act on each other are examined together
RELAYS_ONLY = Finding("silent", "it speaks of relay systems: see theorem_11_6")


@dataclass(frozen=True, slots=True, eq=False)
class WellPosedness:
    """What is proved of the local, right-unique, non-Zeno state from all x0.

    Parameters
    ----------
    verdict : {"well-posed", "ill-posed", "unknown"}
    basis : str
        What the verdict rests on.
    witness : Vector, shape (n,), or None
        For "ill-posed": an x0 without solution, or with several.
    counterexample : IllPosedness or None
        What the exact S(x0) shows at the witness.
    totally_invertible : bool or None
        None where k > 12.
    singular_modes : tuple of tuples of int, or None
        The I with det G_II = 0 for every s.
    theorems : mapping from "11.1" ... "11.6" to {"holds", "fails", "silent"}
        "holds": its conditions are proved; "fails": one without which its conclusion is false is proved to be violated;
        "silent": neither is proved, or it is about other systems.
    reasons : mapping from "11.1" ... "11.6" to str
        The numbers behind each entry.
    passivity : Passivity
    input_unique : bool or None
        Whether the multiplier u is unique from all x0; None: not decided.
    max_multiplicity : int or None
        The largest number of jumps at one instant: 0 where D is a P-matrix, 1 by theorem 11.3 or passivity.
    p_matrix_for_large_s : bool or None
        Whether all principal minors of G(s) are positive for all large s.
    continuity : {"always", "where C x0 + g >= 0"} or None
        The x0 from which the state is continuous, by section 11.2.1, g being constant; None: nothing is proved.
    """

    verdict: Verdict
    basis: str
    witness: Vector | None
    counterexample: IllPosedness | None
    totally_invertible: bool | None
    singular_modes: tuple[IndexSet, ...] | None
    theorems: Mapping[str, Literal["holds", "fails", "silent"]]
    reasons: Mapping[str, str]
    passivity: Passivity
    input_unique: bool | None
    max_multiplicity: int | None
    p_matrix_for_large_s: bool | None
    continuity: Literal["always", "where C x0 + g >= 0"] | None

    @property
    def passive(self) -> bool | None:
        """True and False are proved; None: neither is."""
        return self.passivity.verdict


Minors = Sequence[
    list[fmpz_poly] | None
]  # of G over the pairs of each strongly connected part, None for k > 12


class _Conclusion(NamedTuple):
    verdict: Verdict
    basis: str
    counterexample: IllPosedness | None = None


def well_posedness(system: LCS) -> WellPosedness:
    """Report what is known of existence and uniqueness of solutions from all x0, everything exact.

    The verdict "well-posed" rests on theorems 11.2 to 11.5 or on passivity with Q > 0, if need be after a shift of the
    poles: the state is then unique although G_II may be singular and u may not be unique. "ill-posed" carries an x0
    that shows it. The offsets f, g are taken with all the values that they have in time. Parts of the system that do
    not act on each other are examined one by one where k > 6; S(x0) is then told of the part that shows the
    ill-posedness, its other states being zero.

    Notes
    -----
    Cost: for n = k = 10 and integer data about a second at most. For k > 12 the modes of those parts alone are examined
    in which everything acts on everything, up to 12 pairs each.
    Source: section 11.6, section 11.2.1; Heemels, Schumacher, Weiland 1999.

    Examples
    --------
    >>> report = well_posedness(LCS([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]]))
    >>> report.verdict, report.theorems["11.2"], report.max_multiplicity
    ('well-posed', 'holds', 1)
    >>> report = well_posedness(LCS([[0, 1], [-1, 0]], [[0], [-1]], [[0, 1]]))
    >>> report.verdict, report.counterexample.kind
    ('ill-posed', 'no solution')
    """
    check_type("system", system, LCS)
    parts = [part for part in independent_parts(system) if part.pairs]
    if system.shape[1] > LARGEST_WHOLE and len(parts) > 1:
        return _combined(system, parts)
    return _examined(system)


def _examined(system: LCS) -> WellPosedness:
    k = system.shape[1]
    parts = strongly_connected_parts(system) if k > LARGEST_PAIRS else [Part((), tuple(range(k)), system)]
    minors: Minors = [
        transfer_minors(part.system) if len(part.pairs) <= LARGEST_PAIRS else None
        for part in parts
        if part.pairs or len(parts) == 1
    ]
    findings = {
        "11.1": _of_every_part(theorem_11_1, minors),
        "11.2": theorem_11_2(system),
        "11.3": theorem_11_3(system),
        "11.4": _of_every_part(theorem_11_4, minors),
        "11.5": _of_every_part(theorem_11_5, minors),
        "11.6": RELAYS_ONLY,
    }
    energy, data = passivity(system), rational_system(system)
    monotone = energy.verdict or is_passive_after_pole_shift(data)
    conclusion = _conclude(system, findings, energy, monotone)
    input_unique, ambiguous = _input_uniqueness(system, findings, monotone, conclusion)
    if findings["11.5"].status == "silent" and ambiguous is not None:
        findings["11.5"] = Finding(
            "fails", f"the problem from x0 = {ambiguous.tolist()} is not uniquely solvable"
        )
    invertible = findings["11.1"].status
    return _report(
        findings,
        conclusion,
        totally_invertible=None if invertible == "silent" else invertible == "holds",
        singular_modes=None if k > LARGEST_PAIRS or minors[0] is None else modes_of_zero_minors(minors[0]),
        passivity=energy,
        input_unique=input_unique,
        max_multiplicity=_largest_multiplicity(minors, findings, monotone, conclusion),
        p_matrix_for_large_s=_all_of([None if m is None else all_positive(m) for m in minors]),
        continuity=_continuity(data, monotone),
    )


def _report(
    findings: Mapping[str, Finding],
    conclusion: _Conclusion,
    *,
    totally_invertible: bool | None,
    singular_modes: tuple[IndexSet, ...] | None,
    passivity: Passivity,
    input_unique: bool | None,
    max_multiplicity: int | None,
    p_matrix_for_large_s: bool | None,
    continuity: Literal["always", "where C x0 + g >= 0"] | None,
) -> WellPosedness:
    counterexample = conclusion.counterexample
    return WellPosedness(
        verdict=conclusion.verdict,
        basis=conclusion.basis,
        witness=None if counterexample is None else counterexample.x0,
        counterexample=counterexample,
        totally_invertible=totally_invertible,
        singular_modes=singular_modes,
        theorems=MappingProxyType({name: finding.status for name, finding in findings.items()}),
        reasons=MappingProxyType({name: finding.reason for name, finding in findings.items()}),
        passivity=passivity,
        input_unique=input_unique,
        max_multiplicity=max_multiplicity,
        p_matrix_for_large_s=p_matrix_for_large_s,
        continuity=continuity,
    )


def _of_every_part(theorem: Callable[[list[fmpz_poly] | None], Finding], minors: Minors) -> Finding:
    """Apply a theorem to the diagonal blocks of a block triangular G: det G_II is the product over them."""
    return together([theorem(each) for each in minors])


def _all_of(answers: Sequence[bool | None]) -> bool | None:
    """Return the conjunction, None standing for what is not known."""
    return False if False in answers else None if None in answers else True


def _combined(system: LCS, parts: Sequence[Part]) -> WellPosedness:
    """Put together what is known of the independent parts."""
    reports = [_examined(part.system) for part in parts]
    findings = {
        name: together([Finding(report.theorems[name], report.reasons[name]) for report in reports])
        for name in reports[0].theorems
    }
    findings["11.2"] = theorem_11_2(system)
    conclusion = _conclusion_of_parts(system, parts, reports)
    unique = _all_of([report.input_unique for report in reports])
    jumps = [report.max_multiplicity for report in reports]
    energy = passivity(system)
    data = rational_system(system)
    return _report(
        findings,
        conclusion,
        totally_invertible=_all_of([report.totally_invertible for report in reports]),
        singular_modes=singular_modes(system) if system.shape[1] <= LARGEST_PAIRS else None,
        passivity=energy,
        input_unique=None if unique is False and conclusion.verdict != "well-posed" else unique,
        max_multiplicity=None if None in jumps else max(jump for jump in jumps if jump is not None),
        p_matrix_for_large_s=_all_of([report.p_matrix_for_large_s for report in reports]),
        continuity=_continuity(data, energy.verdict or is_passive_after_pole_shift(data)),
    )


def _conclusion_of_parts(system: LCS, parts: Sequence[Part], reports: Sequence[WellPosedness]) -> _Conclusion:
    if all(report.verdict == "well-posed" for report in reports):
        bases = "; ".join(dict.fromkeys(report.basis for report in reports))
        return _Conclusion("well-posed", f"each of {len(parts)} parts that do not act on each other: {bases}")
    for part, report in zip(parts, reports, strict=True):
        shown = report.counterexample
        if shown is None:
            continue
        others = [(other, of) for other, of in zip(parts, reports, strict=True) if other is not part]
        if shown.kind == "several solutions" and not all(_goes_on_from_zero(*each) for each in others):
            continue
        x0 = np.zeros(system.shape[0])
        x0[list(part.states)] = shown.x0
        sets = tuple(tuple(part.pairs[i] for i in mode) for mode in shown.solution_sets)
        where = f"the witness has {shown.kind} in the pairs {part.pairs}, which act on no others"
        return _Conclusion("ill-posed", where, IllPosedness(x0, shown.kind, sets))
    return _Conclusion("unknown", "no theorem applies to every part, and no witness was found")


def _goes_on_from_zero(part: Part, report: WellPosedness) -> bool:
    """Tell whether x0 = 0 is known to have a solution at all times."""
    if report.verdict == "well-posed":
        return True
    if len(part.pairs) > LARGEST_PAIRS or isinstance(part.system.g, Exosystem):
        return False
    start = np.zeros(len(part.states))
    times = _instants(part.system)
    return all(rational_complementarity(part.system, start, t=t).solution_sets for t in times)


def _conclude(system: LCS, findings: Mapping[str, Finding], energy: Passivity, monotone: bool) -> _Conclusion:
    for name in ("11.2", "11.3", "11.4"):
        if findings[name].status == "holds":
            return _Conclusion("well-posed", f"theorem {name}: {findings[name].reason}")
    times = tuple(_instants(system))
    if monotone:
        data = rational_system(system)
        if not all(has_solutions_everywhere(data, rational_offsets(system, t)[1]) for t in times):
            nothing = IllPosedness(np.zeros(system.shape[0]), "no solution", ())
            return _Conclusion("ill-posed", "no x and u >= 0 have Cx + Du + g >= 0", nothing)
        if not _attains_every_offset(system, data):
            return _Conclusion(
                "unknown", "the state is unique; that there is one for every g(t) was not proved"
            )
        why = (
            f"passivity: {energy.reason}"
            if energy.verdict
            else f"passivity after a shift of the poles: {CRITERION}"
        )
        return _Conclusion("well-posed", f"{why}; the state is unique, u need not be")
    if system.shape[1] <= LARGEST_PAIRS:
        for t in times:
            shown = find_ill_posedness(system, t)
            if shown is not None:
                return _Conclusion(
                    "ill-posed", f"the witness has {shown.kind}: S(x0) = {shown.solution_sets}", shown
                )
    return _Conclusion("unknown", "no theorem applies, and no witness was found")


def _attains_every_offset(system: LCS, data: RationalSystem) -> bool:
    """Tell whether all values of a g that an exosystem makes are attainable, -1 where it is not zero being so."""
    if not isinstance(system.g, Exosystem):
        return True  # its values were examined one by one
    worst = -np.any(system.g.output != 0.0, axis=1).astype(int)
    return has_solutions_everywhere(data, rational_array(worst))


def _input_uniqueness(
    system: LCS, findings: Mapping[str, Finding], monotone: bool, conclusion: _Conclusion
) -> tuple[bool | None, Vector | None]:
    """Return whether u is unique, and an x0 where the problem is not uniquely solvable, if one is known."""
    if findings["11.5"].status == "holds":
        return True, None
    shown = conclusion.counterexample
    if shown is not None:
        return (False if shown.kind == "several solutions" else None), shown.x0
    return _ambiguity(system) if monotone else (None, None)


def _ambiguity(system: LCS) -> tuple[bool | None, Vector | None]:
    """Decide for a system that is passive, or is after a shift, whether u is unique, with an x0 where it is not."""
    data, k = rational_system(system), system.shape[1]
    if not exact_kernel(np.vstack([data.B, data.D + data.D.T])).shape[1]:
        return True, None
    if k > LARGEST_AMBIGUITY:
        return None, None
    proved = not isinstance(system.g, Exosystem)
    for t in _instants(system):
        for x in ambiguous_states(data, rational_offsets(system, t)[1]):
            proved = False
            if not rational_complementarity(system, as_fractions(x), t=t).unique_input:
                return False, rounded(x)
    return (True if proved else None), None


def _largest_multiplicity(
    minors: Minors, findings: Mapping[str, Finding], monotone: bool, conclusion: _Conclusion
) -> int | None:
    if conclusion.verdict != "well-posed":
        return None
    if all(m is not None and all_positive(m) and _keeps_degree(m) for m in minors):
        return 0  # D is a P-matrix
    return 1 if findings["11.3"].status == "holds" or monotone else None


def _keeps_degree(minors: list[fmpz_poly]) -> bool:
    return all(minor.degree() == minors[0].degree() for minor in minors)


def _continuity(data: RationalSystem, monotone: bool) -> Literal["always", "where C x0 + g >= 0"] | None:
    """Apply section 11.2.1: D + D^T > 0, or D = 0 and CB > 0 (symmetric, as C = B^T Q)."""
    if not monotone:
        return None
    if is_exactly_positive_definite(data.D + data.D.T):
        return "always"
    if not data.D.any() and is_exactly_positive_definite(data.C @ data.B):
        return "where C x0 + g >= 0"
    return None


def _instants(system: LCS) -> Iterator[float]:
    """Return one time in every piece of f and g."""
    jumps = sorted({*system.f.jumps.tolist(), *system.g.jumps.tolist()})
    yield jumps[0] - 1.0 if jumps else 0.0
    yield from jumps
