"""Right calls of what reads and writes files, draws, and makes ready mechanisms."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np

import leastaction as la
from api.walk.scenes import (
    TIMES,
    Q,
    continuous,
    flow,
    flow_found,
    flow_price,
    found,
    free_arm,
    guess,
    price,
    run,
    steps,
    tied_run,
)
from api.walk.values import Call
from leastaction import io, models, viz
from leastaction.errors import MissingExtraError, MotionFileError
from leastaction.models.four_bars import four_bars

BVH = (
    "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 5 0\n}\n}\n"
    "MOTION\nFrames: 2\nFrame Time: 0.01\n1 2 3\n1 2 3\n"
)


def calls() -> dict[str, Call]:
    """Return a callable and right arguments by name; files are in the working folder."""
    Path("a.bvh").write_text(BVH)
    table = np.column_stack([TIMES, np.cos(TIMES)])
    np.savetxt("a.csv", table, delimiter=",", header="t,a", comments="")
    run().save("run.npz")
    found().save("result.npz")
    free_arm().save("arm.yaml")
    urdf = (
        '<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
        'iyz="0"/></inertial></link><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
        'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="continuous"><parent link="a"/><child '
        'link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    Path("r.urdf").write_text(urdf)
    capture = io.read_bvh("a.bvh")
    t = 0.01 * np.arange(101)
    motion = io.Motion(("a", "b"), t, np.column_stack([np.cos(t), np.sin(t)]), "made")
    walking = io.Motion(
        ("torso_tx", "torso_ty", "a"), t, np.column_stack([t, 0.1 * t, np.sin(2 * np.pi * 4 * t)]), "made"
    )
    markers = io.Markers(("m",), TIMES, np.zeros((6, 1, 3)))
    scene = viz.mechanism_scene(free_arm(), run().t, run().q)
    io.save_record("record.npz", _record())
    provenance = None
    return {
        "read_bvh": (io.read_bvh, {"path": "a.bvh", "fill": True}),
        "read_capture": (io.read_capture, {"path": "a.bvh", "skeleton": None, "frame_rate": None, "fill": True}),
        "read_amc": (_tried(io.read_amc), {"path": "a.amc", "skeleton": None, "frame_rate": None, "fill": True}),
        "read_motion": (io.read_motion, {"path": "a.csv"}),
        "read_markers": (_tried(io.read_markers), {"path": "a.csv", "unit": None}),
        "open": (la.open, {"path": "run.npz", "mechanism": None}),
        "load": (
            la.load,
            {
                "path": "r.urdf", "floating": False, "fixed": (), "packages": (), "motors": None, "bodies": None,
                "inertia": "strict", "strict": False,
            },
        ),
        "load_result": (io.load_result, {"path": "result.npz"}),
        "save_result": (io.save_result, {"path": "again.npz", "result": found()}),
        "save_record": (
            io.save_record, {"path": "other.npz", "content": _record(), "provenance": provenance, "arrays": None},
        ),
        "load_record": (
            lambda path, kind: io.load_record(path, kind), {"path": "record.npz", "kind": type(_record())},
        ),
        "Mechanism.load": (la.Mechanism.load, {"path": "arm.yaml"}),
        "Mechanism.save": (free_arm().save, {"path": "saved.yaml"}),
        "Trajectory.save": (run().save, {"path": "saved.npz"}),
        "ContinuousTrajectory.save": (continuous().save, {"path": "saved.npz"}),
        "OptimizationResult.save": (found().save, {"path": "saved.npz"}),
        "Capture": (
            io.Capture,
            {
                "path": "a", "joints": capture.joints, "frame_time": 0.01, "values": capture.values, "gaps": (),
                "notes": (),
            },
        ),
        "Capture.motion": (capture.motion, {"unit": 1.0}),
        "Capture.index": (capture.index, {"name": "Hips"}),
        "Capture.is_below": (capture.is_below, {"joint": 0, "ancestor": 0}),
        "forward_kinematics": (io.forward_kinematics, {"capture": capture}),
        "Joint": (
            io.Joint,
            {"name": "j", "parent": -1, "offset": (0.0, 0.0, 0.0), "channels": ("Xrotation",), "line": 1},
        ),
        "Gap": (io.Gap, {"joint": "Hips", "first": 0, "last": 1, "kind": "missing"}),
        "Markers": (io.Markers, {"names": ("m",), "t": TIMES, "places": np.zeros((6, 1, 3)), "source": ""}),
        "Markers.__getitem__": (markers.__getitem__, {"name": "m"}),
        "Markers.renamed": (markers.renamed, {"frames": {"m": "hand"}}),
        "Markers.resample": (markers.resample, {"dt": 0.01}),
        "Markers.seen": (markers.seen, {"name": "m"}),
        "Motion": (io.Motion, {"names": ("a",), "t": TIMES, "q": np.zeros((6, 1)), "source": ""}),
        "Motion.__getitem__": (motion.__getitem__, {"name": "a"}),
        "Motion.columns": (motion.columns, {"names": ["a"]}),
        "Motion.ease_in": (motion.ease_in, {"seconds": 0.2}),
        "Motion.ease_out": (motion.ease_out, {"seconds": 0.2}),
        "Motion.lead_in": (motion.lead_in, {"pose": {"a": 0.0}, "seconds": 0.2}),
        "Motion.loop": (
            walking.loop, {"duration": 1.0, "shortest": 0.1, "travelling": ("torso_tx", "torso_ty")},
        ),
        "Motion.low_pass": (motion.low_pass, {"cutoff": 5.0}),
        "Motion.resample": (motion.resample, {"dt": 0.02, "duration": 0.5, "cutoff": None}),
        "Motion.save": (motion.save, {"path": "saved.csv"}),
        "build": (models.build, {"name": "cart_pendulum"}),
        "andrews.start": (models.andrews.start, {"mechanism": models.build("andrews")}),
        "bricard": (
            models.bricard.bricard, {"length": 1.0, "mass": 1.0, "gravity": (0.0, -9.81, 0.0)},
        ),
        "broad_hand": (models.broad_hand.broad_hand, {"tendons": False}),
        "cart_pendulum": (models.cart_pendulum.cart_pendulum, {}),
        "four_bars": (four_bars, {"loops": 2, "length": 1.0, "mass": 1.0, "gravity": 9.81}),
        "four_bars.at_angle": (
            models.four_bars.at_angle, {"mechanism": four_bars(2), "angle": 0.5, "rate": 0.1},
        ),
        "hand": (models.hand.hand, {"joints": 16, "tendons": True, "force_length": True}),
        "pendulum_chain": (models.chain.pendulum_chain, {}),
        "marionette": (models.marionette.marionette, {"damping": 0.2, "strings": 6, "by": "length"}),
        "puppet_arm.hang": (
            models.puppet_arm.hang,
            {"mechanism": models.build("puppet_arm"), "angles": [0.1, 0.2]},
        ),
        "scissor_lift.at_angle": (
            models.scissor_lift.at_angle, {"mechanism": models.build("scissor_lift"), "angle": 0.5, "rate": 0.1},
        ),
        "show": (
            la.show,
            {
                "what": free_arm(), "q": Q, "shapes": None, "reference": None, "beside": None, "traces": (),
                "up": None, "joints": False, "forces": False, "title": "",
            },
        ),
        "View": (viz.View, {"scenes": (scene,), "joints": False, "forces": False}),
        "View.save": (
            la.show(free_arm(), q=Q).save,
            {"path": "v.html", "at": None, "size": (64, 48), "fps": 25.0, "dark": False},
        ),
        "mechanism_scene": (
            viz.mechanism_scene,
            {
                "mechanism": free_arm(), "t": run().t, "q": run().q, "bones": None, "cords": (), "reference": None,
                "tension": None, "error": None, "traces": (), "focus": "", "title": "",
            },
        ),
        "Scene": (
            viz.Scene,
            {
                "t": TIMES, "points": {"a": np.zeros((6, 3)), "b": np.ones((6, 3))}, "bones": (), "cords": (),
                "ghost": None, "tension": None, "error": None, "traces": (), "focus": "", "base": "",
                "ground": None, "title": "", "arrows": (), "marks": (), "limits": (), "azimuth": 50.0,
                "elevation": 9.0,
            },
        ),
        "Bone": (viz.Bone, {"start": "a", "end": "b", "radius": 0.1, "color": None}),
        "Cord": (viz.Cord, {"name": "c", "start": "a", "end": "b", "via": (), "kind": "string"}),
        "ActiveLimit": (viz.ActiveLimit, {"name": "u", "spans": ((0.0, 1.0),)}),
        "Arrow": (
            viz.Arrow, {"name": "a", "kind": "force", "place": np.zeros((6, 3)), "vector": np.zeros((6, 3))},
        ),
        "animation_page": (viz.animation_page, {"scenes": scene, "joints": False, "forces": False}),
        "write_animation": (viz.write_animation, {"scenes": scene, "path": "a.html"}),
        "save_png": (viz.save_png, {"figure": viz.plot_energy(run()), "path": "f.png", "dpi": 20.0}),
        "tracking_errors": (
            viz.tracking_errors,
            {"reference": np.zeros((6, 2)), "achieved": np.ones((6, 2)), "names": ["a", "b"], "lengths": ()},
        ),
        "plot_convergence": (viz.plot_convergence, {"result": found(), "title": ""}),
        "plot_descent": (
            viz.plot_descent,
            {
                "system": steps(), "cost": price(), "initial": guess(), "methods": ("newton",), "horizon": None,
                "title": "",
            },
        ),
        "plot_descent in continuous time": (
            viz.plot_descent,
            {
                "system": flow(), "cost": flow_price(), "initial": flow_found(), "methods": ("quasi-newton",),
                "horizon": None, "title": "",
            },
        ),
        "plot_energy": (viz.plot_energy, {"run": run(), "title": ""}),
        "plot_feedback": (viz.plot_feedback, {"result": found(), "system": steps(), "title": ""}),
        "plot_limits": (viz.plot_limits, {"result": found(), "title": ""}),
        "plot_poses": (viz.plot_poses, {"run": run(), "times": [0.0, 0.05], "reference": None, "title": ""}),
        "plot_reactions": (viz.plot_reactions, {"run": tied_run(), "names": "*", "title": ""}),
        "plot_residuals": (viz.plot_residuals, {"run": run(), "title": ""}),
        "plot_run": (viz.plot_run, {"run": run(), "names": None, "reference": None, "limits": (), "title": ""}),
        "plot_snapshots": (
            viz.plot_snapshots,
            {
                "scene": scene, "count": 2, "times": None, "azimuth": 30.0, "elevation": 8.0, "ceiling": None,
                "title": "",
            },
        ),
        "plot_strings": (
            viz.plot_strings,
            {
                "t": TIMES, "lengths": np.ones((6, 1)), "tensions": np.ones((6, 1)), "names": ["s"], "title": "",
            },
        ),
        "plot_tracking": (
            viz.plot_tracking,
            {
                "t": TIMES, "reference": np.zeros((6, 2)), "achieved": np.ones((6, 2)), "names": ["a", "b"],
                "lengths": (), "groups": None, "title": "",
            },
        ),
    }  # fmt: skip


def _record():
    return io.Gap("Hips", 0, 1, "missing")


def _tried(read):
    """Return a reader whose right call has no file to read: that it says so is what is right."""

    def call(path, **options):
        with contextlib.suppress(MotionFileError, MissingExtraError):
            return read(path, **options)

    return call
