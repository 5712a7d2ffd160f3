"""Keys and diagnoses made by hand."""

from __future__ import annotations

import math

from bench.proof.judging import judge
from bench.proof.truths import OFF, true_parameters
from sim.effects import catalogue

TOLD = {"seconds": 12.0, "failure": ""}


def effect(name, ratio=5.0, left=None, **parameters):
    """An effect as a key has it; parameters as (value, off), ``left`` as a ratio."""
    told = {k: {"value": v, "unit": "", "off": off} for k, (v, off) in parameters.items()}
    found = {"effect": name, "ratio": ratio, "parameters": told}
    return found if left is None else found | {"left": {"ratio": left, "imitation": {}}}


def key(kind="single", *effects, ordinary=(), style="fast", rig="xl330-pendulum", **more):
    """A key; its oracle is 1e-6 rad^2 on the recordings a and b."""
    return {
        "kind": kind,
        "concealment": "masked" if ordinary else "plain",
        "rig": rig,
        "programme": "slow",
        "style": style,
        "effects": list(effects),
        "ordinary": list(ordinary),
        "noise_floor_rad": 1e-3,
        "oracle": {name: {"group": "held", "mse_rad2": 1e-6} for name in ("a", "b")},
        **more,
    }


def cause(name, probability=0.99, rivals=(), **parameters):
    """A cause as a diagnosis has it; parameters as (value, low, high), rivals as (name, p)."""
    return {
        "effect": name,
        "probability": probability,
        "indistinguishable_from": [{"effect": n, "probability": p} for n, p in rivals],
        "parameters": {
            k: {"value": v, "ci95": [low, high]} for k, (v, low, high) in parameters.items()
        },
    }


def diagnosis(*causes, verdict=None, before=0.01, after=0.002):
    """A diagnosis that judged on the recordings a and b."""
    return {
        "verdict": verdict or ("explained" if causes else "consistent"),
        "causes": list(causes),
        "fit": {"before": before, "after": after, "held_out": True, "recordings": ["a", "b"]},
    }


def judged(a_key, a_diagnosis, name="case-0001", **told):
    """A case of both."""
    return judge(name, a_key, a_diagnosis, TOLD | told)


def hidden_in(name, joints, ratio=5.0, **parameters):
    """An effect as the key of a robot has it, with the joints that it is in."""
    return {**effect(name, ratio, **parameters), "joints": list(joints)}


def robot_key(kind="single", *effects, ordinary=(), rig="marvin-walk", stance_share=0.9, **more):
    """The key of a robot; ``stance_share`` is of all that is hidden."""
    found = key(kind, *effects, ordinary=ordinary, rig=rig, stance_share=stance_share)
    del found["programme"], found["style"]
    return found | more


def placed(name, scope=(), probability=0.99, **more):
    """A cause of a robot, at some places; none: in the whole robot."""
    return {**cause(name, probability, **more), "scope": list(scope)}


def mismatch(joints, phase, share=0.5):
    """A place of a misfit."""
    return {"joints": list(joints), "phase": phase, "share": share}


def robot_diagnosis(*causes, places=(), **more):
    """A diagnosis of a robot with the places of its misfit."""
    return diagnosis(*causes, **more) | {"mismatch": list(places)}


def tells(concealed, rig):
    """Checks that an effect as its key has it is told in the catalogue's own words and counts."""
    found = true_parameters(concealed, rig)
    known = {p.name: p for p in catalogue()[concealed["effect"]].parameters}
    assert found
    assert set(found) <= set(known)
    main = next(iter(found))
    assert found[main].off == known[main].off == OFF.get(concealed["effect"], 0.0)
    assert found[main].value != known[main].off
    assert all(math.isfinite(true.value) for true in found.values())
