"""Ready models as problem files name them, with poses that they hold by themselves."""

from __future__ import annotations

from collections.abc import Callable

from leastaction.io.mechanisms import Keyframe, Model
from leastaction.mechanics import Mechanism
from leastaction.models import build
from leastaction.models.marionette import rest_pose
from leastaction.numerics.arrays import Array

_AT_REST: dict[str, Callable[[Mechanism], Array]] = {"marionette": rest_pose}


def ready_model(name: str) -> Model:
    """Return a ready model by name; where it has a pose at rest, that is its keyframe ``rest``."""
    mechanism = build(name)
    poses = {"rest": _AT_REST[name](mechanism)} if name in _AT_REST else {}
    keyframes = {each: Keyframe(q=mechanism.named(q)) for each, q in poses.items()}
    return Model(
        mechanism=mechanism, name=name, keyframes=keyframes, reference=dict(keyframes["rest"].q) if keyframes else {}
    )
