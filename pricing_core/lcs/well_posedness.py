"""Well-posedness: existence and uniqueness of the state from every x0 (section 11.6), as one report."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from flint import fmpz_poly

from pricing_core.arrays import IndexSet, Vector
from pricing_core.lcs.ill_posedness import IllPosedness, find_ill_posedness, shows_ill_posedness
from pricing_core.lcs.passive_consequences import LARGEST_PAIRS as LARGEST_AMBIGUITY
from pricing_core.lcs.passive_consequences import ambiguous_states, has_solutions_everywhere
from pricing_core.lcs.passivity import Passivity, passivity
from pricing_core.lcs.rational_complementarity import rational_complementarity
from pricing_core.lcs.rational_system import rational_offsets, rational_system
from pricing_core.lcs.system import LCS
from pricing_core.lcs.theorems import (
    Finding,
    theorem_11_1,
    theorem_11_2,
    theorem_11_3,
    theorem_11_4,
    theorem_11_5,
)
from pricing_core.lcs.total_invertibility import LARGEST_PAIRS, modes_of_zero_minors, transfer_minors
from pricing_core.linalg.principal_minors import all_positive
from pricing_core.linalg.rational import as_fractions, exact_kernel, rounded
from pricing_core.linalg.rational_definite import is_exactly_positive_definite

Verdict = Literal["well-posed", "ill-posed", "unknown"]
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
        "holds": the hypotheses are proved; "fails": the contrary is; "silent" otherwise.
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
        From which x0 the state is continuous, by section 11.2.1, g being constant; None: nothing is proved.
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


class _Conclusion(NamedTuple):
    verdict: Verdict
    basis: str
    counterexample: IllPosedness | None = None


def well_posedness(system: LCS) -> WellPosedness:
    """Report what is known of existence and uniqueness of solutions from all x0, everything exact.

    The verdict "well-posed" rests on theorems 11.2 to 11.5 or on passivity with Q > 0: the state is then unique
    although G_II may be singular and u may not be unique. "ill-posed" carries an x0 that shows it.
    The offsets f, g are taken with all the values that they have in time.

    Notes
    -----
    Cost: for n = k = 10 and integer data about a second at most. For k > 12 the modes are not examined.
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
    minors = transfer_minors(system) if system.shape[1] <= LARGEST_PAIRS else None
    findings = {
        "11.1": theorem_11_1(minors),
        "11.2": theorem_11_2(system),
        "11.3": theorem_11_3(system),
        "11.4": theorem_11_4(minors),
        "11.5": theorem_11_5(minors),
        "11.6": RELAYS_ONLY,
    }
    energy = passivity(system)
    conclusion = _conclude(system, findings, energy)
    input_unique, ambiguous = _input_uniqueness(system, findings, energy, conclusion)
    if findings["11.5"].status == "silent" and ambiguous is not None:
        findings["11.5"] = Finding(
            "fails", f"the problem from x0 = {ambiguous.tolist()} is not uniquely solvable"
        )
    counterexample = conclusion.counterexample
    return WellPosedness(
        verdict=conclusion.verdict,
        basis=conclusion.basis,
        witness=None if counterexample is None else counterexample.x0,
        counterexample=counterexample,
        totally_invertible=None if minors is None else findings["11.1"].status == "holds",
        singular_modes=None if minors is None else modes_of_zero_minors(minors),
        theorems=MappingProxyType({name: finding.status for name, finding in findings.items()}),
        reasons=MappingProxyType({name: finding.reason for name, finding in findings.items()}),
        passivity=energy,
        input_unique=input_unique,
        max_multiplicity=_largest_multiplicity(minors, findings, energy, conclusion),
        p_matrix_for_large_s=None if minors is None else all_positive(minors),
        continuity=_continuity(system, energy),
    )


def _conclude(system: LCS, findings: Mapping[str, Finding], energy: Passivity) -> _Conclusion:
    for name in ("11.2", "11.3", "11.4"):
        if findings[name].status == "holds":
            return _Conclusion("well-posed", f"theorem {name}: {findings[name].reason}")
    times = tuple(_instants(system))
    if energy.verdict:
        data = rational_system(system)
        for t in times:
            if not has_solutions_everywhere(data, rational_offsets(system, t)[1]):
                shown = shows_ill_posedness(system, np.zeros(system.shape[0]), t)
                return _Conclusion("ill-posed", "no x and u >= 0 have Cx + Du + g >= 0", shown)
        return _Conclusion("well-posed", f"passivity: {energy.reason}; the state is unique, u need not be")
    if system.shape[1] <= LARGEST_PAIRS:
        for t in times:
            shown = find_ill_posedness(system, t)
            if shown is not None:
                return _Conclusion(
                    "ill-posed", f"the witness has {shown.kind}: S(x0) = {shown.solution_sets}", shown
                )
    return _Conclusion("unknown", "no theorem applies, and no witness was found")


def _input_uniqueness(
    system: LCS, findings: Mapping[str, Finding], energy: Passivity, conclusion: _Conclusion
) -> tuple[bool | None, Vector | None]:
    """Return whether u is unique, and an x0 where the problem is not uniquely solvable, if one is known."""
    if findings["11.5"].status == "holds":
        return True, None
    shown = conclusion.counterexample
    if shown is not None:
        return (False if shown.kind == "several solutions" else None), shown.x0
    return _ambiguity(system) if energy.verdict else (None, None)


def _ambiguity(system: LCS) -> tuple[bool | None, Vector | None]:
    """Decide for a passive system whether u is unique, with an x0 where it is not."""
    data, k = rational_system(system), system.shape[1]
    if not exact_kernel(np.vstack([data.B, data.D + data.D.T])).shape[1]:
        return True, None
    if k > LARGEST_AMBIGUITY:
        return None, None
    proved = True
    for t in _instants(system):
        for x in ambiguous_states(data, rational_offsets(system, t)[1]):
            proved = False
            if not rational_complementarity(system, as_fractions(x), t=t).unique_input:
                return False, rounded(x)
    return (True if proved else None), None


def _largest_multiplicity(
    minors: list[fmpz_poly] | None,
    findings: Mapping[str, Finding],
    energy: Passivity,
    conclusion: _Conclusion,
) -> int | None:
    if conclusion.verdict != "well-posed":
        return None
    if minors is not None and all_positive(minors) and all(m.degree() == minors[0].degree() for m in minors):
        return 0  # D is a P-matrix
    return 1 if findings["11.3"].status == "holds" or energy.verdict else None


def _continuity(system: LCS, energy: Passivity) -> Literal["always", "where C x0 + g >= 0"] | None:
    """Apply section 11.2.1: D + D^T > 0, or D = 0 and CB > 0 (symmetric, as C = B^T Q)."""
    if not energy.verdict:
        return None
    data = rational_system(system)
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
