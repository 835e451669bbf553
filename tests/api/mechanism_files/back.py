"""What a mechanism that went through a file is held to: the same one, bit by bit."""

from __future__ import annotations

import pickle
from typing import Literal

import numpy as np

from leastaction import Mechanism
from leastaction.mechanics.mechanism.record import plan_data, plan_of
from leastaction.numerics.documents import document_of, document_text


def text_of(mechanism: Mechanism, notation: Literal["yaml", "json"] = "yaml") -> str:
    return document_text(plan_data(mechanism._plan), notation)


def from_text(text: str, notation: Literal["yaml", "json"] = "yaml") -> Mechanism:
    return Mechanism._of(plan_of(document_of(text, notation)))


def check_back(mechanism: Mechanism) -> Mechanism:
    """Write a mechanism as text, read it, and compare all that it is and computes."""
    text = text_of(mechanism)
    again = from_text(text)
    assert text_of(again) == text
    assert again == mechanism
    assert hash(again) == hash(mechanism)
    assert from_text(text_of(mechanism, "json"), "json") == mechanism
    assert str(again) == str(mechanism)
    assert again.frames == mechanism.frames
    assert again.constraints == mechanism.constraints
    assert repr(again.parameters) == repr(mechanism.parameters)
    same_bits(mechanism, again)
    carried = pickle.loads(pickle.dumps(again))
    assert carried == mechanism
    same_bits(mechanism, carried)
    return again


def same_bits(first: Mechanism, second: Mechanism) -> None:
    """Compare the numbers of two mechanisms, and derivatives of both."""
    assert first.core.numbers.tobytes() == second.core.numbers.tobytes()
    rng = np.random.default_rng(5)
    q, v = rng.uniform(-1.0, 1.0, first.nq), rng.uniform(-1.0, 1.0, first.nv)
    for rotation in first.tree.rotations:
        place = first.coordinates.index(rotation.quaternion[0])
        q[place : place + 4] /= np.linalg.norm(q[place : place + 4])
    for one, other in zip(first.core.hessian(q, v), second.core.hessian(q, v), strict=True):
        assert one.tobytes() == other.tobytes()
    assert first.constraint_jacobian(q).tobytes() == second.constraint_jacobian(q).tobytes()
    u = np.linspace(-1.0, 1.0, first.n_inputs)
    assert first.core.force(q, v, u).tobytes() == second.core.force(q, v, u).tobytes()
