"""The marionette on strings follows a motion: tracking, retargeting of captures, the made-up walk, its scene.

An application on top of `leastaction`, of whose public names it is made; `leastaction optimize marionette` is its
command. Its names are loaded when they are first used, so that the command's help does not wait for them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from leastaction_marionette.at_rest import RestingPoses, plot_resting, resting
    from leastaction_marionette.bars import plot_bars
    from leastaction_marionette.choices import Axis, Follow, Heading, Strings
    from leastaction_marionette.markers import MARKERS, plot_markers
    from leastaction_marionette.on_a_rig import RigCheck, check
    from leastaction_marionette.retargeting import (
        VARIABLES,
        Proportions,
        PuppetMotion,
        Retargeted,
        default_names,
        load_motion,
        map_joints,
        puppet_points,
        read_mapping,
        retarget,
    )
    from leastaction_marionette.scene import marionette_scene
    from leastaction_marionette.speeds import AtSpeed, fastest, plot_speeds
    from leastaction_marionette.tracking import (
        FORCED,
        GENTLE,
        PuppetLimits,
        TrackingCost,
        TrackingRun,
        TrackingSearch,
        TrackingWeights,
        load_run,
        load_unfinished,
        save_run,
        save_search,
        track,
    )
    from leastaction_marionette.walk import walk_in_place

_MODULES = {
    "bars": "plot_bars",
    "on_a_rig": "RigCheck check",
    "choices": "Axis Follow Heading Strings",
    "markers": "MARKERS plot_markers",
    "at_rest": "RestingPoses plot_resting resting",
    "retargeting": (
        "VARIABLES Proportions PuppetMotion Retargeted default_names load_motion map_joints puppet_points read_mapping "
        "retarget"
    ),
    "scene": "marionette_scene",
    "speeds": "AtSpeed fastest plot_speeds",
    "tracking": (
        "FORCED GENTLE PuppetLimits TrackingCost TrackingRun TrackingSearch TrackingWeights load_run load_unfinished "
        "save_run save_search track"
    ),
    "walk": "walk_in_place",
}

__all__ = [
    "FORCED", "GENTLE", "MARKERS", "VARIABLES", "AtSpeed", "Axis", "Follow", "Heading", "Proportions", "PuppetLimits",
    "PuppetMotion", "RestingPoses", "Retargeted", "RigCheck", "Strings", "TrackingCost", "TrackingRun",
    "TrackingSearch", "TrackingWeights", "check", "default_names", "fastest", "load_motion", "load_run",
    "load_unfinished", "map_joints", "marionette_scene", "plot_bars", "plot_markers", "plot_resting", "plot_speeds",
    "puppet_points", "read_mapping", "resting", "retarget", "save_run", "save_search", "track", "walk_in_place",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names.split():
            return getattr(import_module(f"leastaction_marionette.{module}"), name)
    raise AttributeError(f"module 'leastaction_marionette' has no attribute {name!r}", name=name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
