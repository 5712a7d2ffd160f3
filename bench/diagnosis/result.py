"""What a diagnosis says: the answers of ``busemu-diagnosis/1``, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from bench.files import finite

FORMAT = "busemu-diagnosis/1"
VERDICTS = ("consistent", "explained", "partly_explained", "unexplained")


def verdict_of(named: bool, left: bool) -> str:
    """The verdict where causes are named or not, and something that repeats is left or not."""
    if named:
        return "partly_explained" if left else "explained"
    return "unexplained" if left else "consistent"


#: effects that say a number was wrong; all others say that physics was missing
WRONG_VALUES = frozenset(
    {
        "back_emf",
        "coulomb_friction",
        "com_offset",
        "gain_error",
        "leg_geometry",
        "link_mass",
        "read_skew",
        "rotor_inertia",
        "stall_torque",
        "supply_voltage",
        "torque_constant",
        "viscous_friction",
        "zero_offset",
    }
)


#: share of what can be explained that a cause is taken to have at least, beside a rest: one that
#: shows in another register than positions explains none of theirs; assumed
LEAST_PART = 0.1
DEAD = "dead"  #: state of a parameter that recordings do not depend on: its value means nothing


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter with its 95 % interval."""

    value: float
    ci95: tuple[float, float]
    unit: str
    state: str = "pinned"  #: pinned, flat, at bound, dead, or "trade-off with ..."


@dataclass(frozen=True, slots=True)
class Rival:
    """Another effect that the data cannot tell from the named one."""

    effect: str
    scope: tuple[str, ...]
    probability: float
    behind_nats: float  #: how much less it gains, deflated


@dataclass(frozen=True, slots=True)
class Cause:
    """A named effect with its evidence.

    ``shown_by`` is what shows it, and what its share is of, where those are not the positions.
    """

    effect: str
    scope: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    held_out_gain_nats: float
    explained_share: float
    probability: float
    indistinguishable_from: tuple[Rival, ...] = ()
    shown_by: str = ""

    @property
    def kind(self) -> str:
        """``missing`` or ``wrong_value``."""
        return "wrong_value" if self.effect in WRONG_VALUES else "missing"


def part_beside(explained_share: float, foretold: float, explainable: float) -> float:
    """A cause's part of what it explains and a foretold rest together; squares are in rad^2."""
    own = max(explained_share, LEAST_PART)
    return own / (own + foretold / max(explainable, 1e-30))


def beside_rest(cause: Cause, foretold: float, explainable: float, shown: float = 0.0) -> Cause:
    """A cause beside a rest that is foretold and has no name: its square, and all [rad^2].

    What makes the rest may be what made the other part as well, and then the cause is not. So it
    is no likelier than its part of both; nor are its rivals, which leave as much. ``shown`` is the
    share that it takes of what is left of another register, if that is more.
    """
    part = max(shown, part_beside(cause.explained_share, foretold, explainable))
    rivals = (replace(r, probability=part * r.probability) for r in cause.indistinguishable_from)
    return replace(
        cause, probability=part * cause.probability, indistinguishable_from=tuple(rivals)
    )


@dataclass(frozen=True, slots=True)
class FitSummary:
    """Deviation of positions before and after [rad]."""

    before: float
    after: float
    noise_floor: float
    held_out: bool
    recordings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class NextExperiment:
    """What to record next, what it would tell apart, and how likely it would."""

    experiment: str
    arguments: Mapping[str, Any]
    separates: tuple[str, ...]
    power: float


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All answers. ``channels`` says of every residual kind how it fared, before and after."""

    verdict: str
    mismatch: tuple[Mapping[str, Any], ...]
    causes: tuple[Cause, ...]
    fit: FitSummary
    unexplained: tuple[Mapping[str, Any], ...]
    next_experiment: tuple[NextExperiment, ...]
    limits: tuple[str, ...]
    channels: tuple[Mapping[str, Any], ...] = ()
    rejected: tuple[Mapping[str, Any], ...] = ()  #: names that fit but contradict a channel
    ranking: tuple[Mapping[str, Any], ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """As ``diagnosis.json`` has it; a number that JSON lacks is ``null``."""
        told = {
            "format": FORMAT,
            "verdict": self.verdict,
            "mismatch": [dict(m) for m in self.mismatch],
            "causes": [
                {
                    "effect": c.effect,
                    "scope": list(c.scope),
                    "kind": c.kind,
                    "parameters": {
                        name: {
                            "value": e.value,
                            "ci95": list(e.ci95),
                            "unit": e.unit,
                            "state": e.state,
                        }
                        for name, e in c.parameters.items()
                    },
                    "held_out_gain_nats": c.held_out_gain_nats,
                    "explained_share": c.explained_share,
                    "probability": c.probability,
                    "indistinguishable_from": [
                        asdict(r) | {"scope": list(r.scope)} for r in c.indistinguishable_from
                    ],
                }
                | ({"shown_by": c.shown_by} if c.shown_by else {})
                for c in self.causes
            ],
            "fit": {"metric": "rmse_rad"}
            | asdict(self.fit)
            | {"recordings": list(self.fit.recordings)},
            "unexplained": [dict(u) for u in self.unexplained],
            "next_experiment": [
                {
                    "experiment": n.experiment,
                    "arguments": dict(n.arguments),
                    "separates": list(n.separates),
                    "power": n.power,
                }
                for n in self.next_experiment
            ],
            "limits": list(self.limits),
            "channels": [dict(c) for c in self.channels],
            "rejected": [dict(r) for r in self.rejected],
            "ranking": [dict(r) for r in self.ranking],
            "details": dict(self.details),
        }
        known: dict[str, Any] = finite(told)
        return known
