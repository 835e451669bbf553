"""The commands for any mechanism, on ready models, robots' files and files of our own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

import leastaction as la
from leastaction.apps.cli.app import app
from leastaction.mechanics import MidpointVI, SimulationStatus
from leastaction.models import build

MODELS = Path(__file__).parents[2] / "examples" / "models"
PROBLEMS = MODELS.parent / "problems"

TWO_LINKS = """leastaction: mechanism 1
frames:
  - type: ry
    value: shoulder
    children:
      - {type: tz, value: -0.5, name: upper, mass: 1.0}
      - type: tz
        value: -1.0
        children:
          - type: ry
            value: elbow
            children:
              - {type: tz, value: -0.5, name: lower, mass: 1.0}
elements:
  - {type: Gravity, vector: [0.0, 0.0, -9.81]}
  - {type: JointForce, variable: shoulder, input: motor}
"""


@pytest.fixture
def two_links(tmp_path: Path) -> Path:
    """A double pendulum with a motor at its shoulder, written by hand."""
    file = tmp_path / "two.yaml"
    file.write_text(TWO_LINKS, encoding="utf-8")
    return file


def said(leastaction, *words: object) -> dict[str, object]:
    """Run a command that is to succeed and return what it prints as JSON."""
    code, out, err = leastaction(*words, "--json")
    assert code == 0, err
    facts = json.loads(out)
    assert isinstance(facts, dict)
    return facts


def upright_cart() -> tuple[np.ndarray, np.ndarray]:
    """A and B of the ready cart with its pole upright: 10 kg, 1 kg at 1 m, damping 0.01 of both variables."""
    mass = np.array([[11.0, -1.0], [-1.0, 1.0]])  # the bob is at x + sin(theta), and at theta = pi
    stiffness, damping = np.diag([0.0, 9.8]), -0.01 * np.eye(2)
    solved = np.linalg.solve(mass, np.hstack([stiffness, damping, [[1.0], [0.0]]]))
    return np.block([[np.zeros((2, 2)), np.eye(2)], [solved[:, :4]]]), np.vstack([np.zeros((2, 1)), solved[:, 4:]])


Q, R = np.diag([2.0, 5.0, 0.1, 0.3]), np.array([[0.7]])
PRICES = ("--weight", "x=2", "--weight", "theta=5", "--weight", "theta.v=0.3", "--effort", "x-force=0.7")


def test_gains_of_a_cart_are_those_of_riccati(leastaction) -> None:
    facts = said(leastaction, "lqr", "cart_pendulum", "--set", "theta=180deg", *PRICES)
    A, B = upright_cart()
    K = np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))
    assert facts["states"] == ["x", "theta", "x.v", "theta.v"]
    np.testing.assert_allclose(facts["K"], K, rtol=1e-7)
    expected = np.sort_complex(np.linalg.eigvals(A - B @ K))
    found = np.sort_complex([complex(*each) for each in facts["eigenvalues"]])
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_gains_of_a_digital_controller(leastaction) -> None:
    dt = 0.05
    facts = said(leastaction, "lqr", "cart_pendulum", "--set", "theta=180deg", *PRICES, "--dt", dt)
    A, B = upright_cart()
    held = expm(dt * np.block([[A, B], [np.zeros((1, 5))]]))
    A, B = held[:4, :4], held[:4, 4:]
    P = solve_discrete_are(A, B, Q, R)
    np.testing.assert_allclose(facts["K"], np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A), rtol=1e-6)
    assert max(abs(complex(*each)) for each in facts["eigenvalues"]) < 1.0
    # Short steps come to continuous time.
    short = said(leastaction, "lqr", "cart_pendulum", "--set", "theta=180deg", *PRICES, "--dt", 1e-4)
    continuous = said(leastaction, "lqr", "cart_pendulum", "--set", "theta=180deg", *PRICES)
    np.testing.assert_allclose(short["K"], continuous["K"], rtol=2e-3)


def test_gains_hold_a_platform_on_closed_loops(leastaction) -> None:
    pytest.importorskip("mujoco")
    file = MODELS / "stewart.xml"
    facts = said(leastaction, "lqr", file)
    assert len(facts["eigenvalues"]) == 12
    assert max(real for real, _ in facts["eigenvalues"]) < -0.1
    # Held by its six legs, each bears a sixth of the weight of the platform, and stands still under them.
    m = la.load(file).mechanism
    q = m.configuration(facts["q"])
    a = la.ContinuousDynamics(m).accelerations(q, np.zeros(m.nv), np.array(facts["u"])).a
    assert np.abs(a).max() < 1e-6
    assert np.ptp(facts["u"]) < 1e-5 * max(facts["u"])


def test_gains_of_an_arm_fit_a_terminal(leastaction, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = leastaction("lqr", MODELS / "arm.urdf")
    assert code == 0
    assert "lift.torque" in out
    assert "…" not in out
    assert "the slowest motion dies away at" in out


@pytest.mark.parametrize("name", ["cart_pendulum", "andrews", "arm.urdf", "stewart.xml"])
def test_what_is_in_order_passes_the_checks(leastaction, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    if "." in name:
        pytest.importorskip("mujoco")
    monkeypatch.setenv("COLUMNS", "80")
    source = MODELS / name if "." in name else name
    code, out, err = leastaction("check", source)
    facts = json.loads(leastaction("check", source, "--json")[1])
    assert (code, err) == (0, ""), out
    assert facts["good"]
    assert [each["what"] for each in facts["checks"]] == [
        "size", "masses", "mass matrix", "loops", "rest", "derivatives",
    ]  # fmt: skip
    assert "look" not in out
    assert max(map(len, out.splitlines())) <= 80


def test_an_impossible_inertia_is_found(leastaction, tmp_path: Path) -> None:
    file = tmp_path / "odd.yaml"
    file.write_text(
        "leastaction: mechanism 1\nframes:\n"
        "  - {type: rx, value: a, name: plate, "
        "bodies: [{mass: 1.0, inertia: [1.0, 1.0, 9.0], allow_nonphysical: true}]}\n",
        encoding="utf-8",
    )
    code, out, err = leastaction("check", file)
    assert (code, err) == (1, "")
    assert "no real body has the inertia of plate" in " ".join(out.split())
    file.write_text(file.read_text().replace("9.0", "1.9"), encoding="utf-8")
    assert leastaction("check", file)[0] == 0


def test_a_singular_pose_is_found(leastaction) -> None:
    # Four bars are drawn in a line, from which they may go on in two ways.
    code, out, err = leastaction("check", "four_bars")
    assert (code, err) == (1, "")
    assert "in a singular configuration" in " ".join(out.split())
    facts = json.loads(leastaction("check", "four_bars", "--json")[1])
    assert not facts["good"]
    assert "loops" in [each["what"] for each in facts["checks"] if not each["good"]]


def test_a_simulation_is_written_whole(leastaction, tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    pytest.importorskip("matplotlib")
    out = tmp_path / "run"
    words = ("simulate", "cart_pendulum", "--set", "theta=60deg", "--until", 0.5, "--dt", 0.01, "--input", "x-force=2")
    facts = said(leastaction, *words, "--out", out)
    assert sorted(file.name for file in out.iterdir()) == ["energy.png", "motion.html", "run.h5", "states.png"]
    assert sorted(facts["written"]) == sorted(str(file) for file in out.iterdir())
    m = build("cart_pendulum")
    t = 0.01 * np.arange(51)
    vi = MidpointVI(m)
    expected = vi.simulate(vi.start(m.configuration({"theta": np.pi / 3})), t, inputs=np.full((50, 1), 2.0))
    run = la.open(out / "run.h5")
    np.testing.assert_allclose(run.q, expected.q, atol=1e-12)
    assert facts["status"] == "COMPLETED"
    assert facts["steps"] == 50
    assert facts["last"] == pytest.approx(m.named(expected.q[-1]))
    assert (out / "motion.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    # What was written is a source of the other commands.
    code, text, _ = leastaction("info", out / "run.h5")
    assert code == 0
    assert "50 steps" in text
    assert leastaction("view", out / "run.h5", "--out", tmp_path / "again.html")[0] == 0
    assert leastaction("convert", out / "run.h5", tmp_path / "run.csv")[0] == 0
    assert len((tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()) >= 52


def test_what_is_in_a_capture(leastaction, tmp_path: Path) -> None:
    hips = "ROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n"
    knee = "JOINT Knee\n{\nOFFSET 0 -1 0\nCHANNELS 1 Xrotation\nEnd Site\n{\nOFFSET 0 -1 0\n}\n}\n}\n"
    motion = "MOTION\nFrames: 3\nFrame Time: 0.5\n0 0 0 1\n0 0 0 2\n0 0 0 3\n"
    (tmp_path / "step.bvh").write_text("HIERARCHY\n" + hips + knee + motion, encoding="utf-8")
    code, text, err = leastaction("info", tmp_path / "step.bvh")
    assert code == 0, err
    assert "3 frames of 0.5 s, 1 s in all" in text
    assert "root 'Hips' with Xposition, Yposition, Zposition\n2 joints: Hips, Knee" in text


def test_a_folder_is_looked_at_before_the_run(leastaction, two_links: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(MidpointVI, "simulate", None)
    code, out, err = leastaction("simulate", two_links, "--out", two_links)
    assert (code, out) == (2, "")
    assert "is a file" in err


def test_ctrl_c_keeps_what_was_made(leastaction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from leastaction.apps.cli.mechanism import simulation

    simulated = simulation.simulated

    def cut_off(m, q, t, inputs, told):
        def stop(done: int) -> None:
            told(done)
            raise KeyboardInterrupt

        return simulated(m, q, t, inputs, stop)

    monkeypatch.setattr(simulation, "simulated", cut_off)
    code, out, err = leastaction(
        "simulate", "cart_pendulum", "--set", "theta=1", "--until", 50, "--out", tmp_path / "run"
    )
    assert (code, err) == (130, "")
    assert "interrupted after" in out
    (file,) = (tmp_path / "run").glob("run.*")
    run = la.open(file)
    assert run.status is SimulationStatus.INTERRUPTED
    assert 0 < run.steps < 10_000
    assert (tmp_path / "run" / "motion.html").exists()


def test_a_robot_becomes_a_file_of_ours(leastaction, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("matplotlib")
    for name in ("arm.urdf", "stewart.xml"):
        file = tmp_path / f"{name}.yaml"
        assert leastaction("convert", MODELS / name, file) == (0, f"written: {file}\n", "")
        assert la.load(file).mechanism == la.load(MODELS / name).mechanism
    arm = tmp_path / "arm.urdf.yaml"
    pose = ("--set", "lift=30deg", "--set", "elbow=-0.5", "--until", 0.05)
    assert said(leastaction, "simulate", arm, *pose) == said(leastaction, "simulate", MODELS / "arm.urdf", *pose)
    assert leastaction("view", arm, "--out", tmp_path / "arm.png")[0] == 0
    assert (tmp_path / "arm.png").read_bytes().startswith(b"\x89PNG")


def test_a_ready_model_becomes_a_file(leastaction, tmp_path: Path) -> None:
    file = tmp_path / "cart.json"
    assert leastaction("convert", "cart_pendulum", file)[0] == 0
    assert la.Mechanism.load(file) == build("cart_pendulum")


def test_a_file_written_by_hand_goes_through_every_command(leastaction, two_links: Path, tmp_path: Path) -> None:
    assert leastaction("check", two_links)[0] == 0
    assert leastaction("view", two_links, "--out", tmp_path / "two.html")[0] == 0
    assert leastaction("simulate", two_links, "--until", 0.1)[0] == 0
    assert max(real for real, _ in said(leastaction, "lqr", two_links, "--set", "shoulder=180deg")["eigenvalues"]) < 0
    facts = said(leastaction, "info", two_links)
    assert facts["inputs"] == {"motor": "N m"}
    assert facts["mass"] == 2.0
    times = said(leastaction, "bench", two_links)["us"]
    assert len(times) == 5
    assert all(0.0 < each < 1e4 for each in times.values())


def test_the_view_opens_in_the_browser(leastaction, monkeypatch: pytest.MonkeyPatch) -> None:
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url, *_, **__: opened.append(url) or True)
    assert leastaction("view", "cart_pendulum")[0] == 0
    assert len(opened) == 1


def test_numbers_of_an_optimisation(leastaction, two_links: Path, tmp_path: Path) -> None:
    problem = tmp_path / "problem.yaml"
    problem.write_text(
        "leastaction: problem 1\ntitle: Lift\nmodel: two.yaml\ntime: {duration: 0.5, steps: 20}\n"
        "wanted:\n  - {type: constant, name: shoulder, value: 0.3}\n",
        encoding="utf-8",
    )
    words = ("optimize", problem, "--out", tmp_path / "lift", "--no-plots", "--no-animation")
    code, out, err = leastaction(*words, "--json")
    facts = json.loads(out)
    assert code == 0
    assert facts == json.loads((tmp_path / "lift" / "summary.json").read_text(encoding="utf-8"))
    assert facts["status"] == "CONVERGED"
    assert "newton" in err
    # Without a result there are no numbers, and those of an earlier run are not printed for it.
    problem.write_text(problem.read_text(encoding="utf-8").replace("shoulder", "knee"), encoding="utf-8")
    code, out, err = leastaction(*words, "--json")
    assert (code, out) == (2, "")
    assert "knee" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["check", "four_bar"], "did you mean 'four_bars'?"),
        (["simulate", "absent.urdf"], "absent.urdf: there is no such file"),
        (["view", "absent.h5"], "absent.h5"),
        (["simulate", "cart_pendulum", "--set", "theat=1"], "--set: unknown name 'theat'"),
        (["simulate", "cart_pendulum", "--set", "theta="], "expected a name and a number"),
        (["simulate", "cart_pendulum", "--set", "theta=nan"], "expected a name and a number"),
        (["check", "cart_pendulum", "--at", "home"], "unknown keyframe 'home'"),
        (["simulate", "cart_pendulum", "--input", "push=1"], "the names are 'x-force'"),
        (["simulate", "cart_pendulum", "--until", "-1"], "0 < dt <= until"),
        (["simulate", "cart_pendulum", "--dt", "1e-12"], "take longer ones"),
        (["bench", "cart_pendulum", "--dt", "0"], "--dt: got 0 s"),
        (["lqr", "cart_pendulum", "--dt", "-1"], "--dt: got -1 s"),
        (["lqr", "cart_pendulum", "--weight", "pole=1"], "--weight: unknown name 'pole'"),
        (["lqr", "cart_pendulum", "--weight", "*=-1"], "at least zero"),
        (["lqr", "cart_pendulum", "--effort", "*=0"], "above zero"),
        (["lqr", "cart_pendulum", "--set", "theta=1"], "no inputs hold the mechanism"),
        (["lqr", "four_bars"], "has no inputs"),
        (["convert", "cart_pendulum", "cart.h5"], "a model is written as .yaml, .yml, .json, not as .h5"),
        (["convert", "cart_pendulum", "cart"], "without an ending"),
        (["convert", "run.npz", "run.yaml"], "a run is written as .h5, .npz, .csv, .mat"),
        (["convert", "notes.txt", "run.csv"], "notes.txt"),
        (["simulate", "run.npz"], "got run.npz, expected a model"),
        (["lqr", "run.h5"], "got run.h5, expected a model"),
        (["optimize", "arm.urdf", "--out", "x"], "expected a problem file"),
        (["optimize", "cart.yaml", "--out", "x"], "cart.yaml"),
        (["view", "cart_pendulum", "--out", "cart.doc"], "expected one of .html"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(
    leastaction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = leastaction(*words)
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert message in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_files_of_the_wrong_kind(leastaction, two_links: Path, tmp_path: Path) -> None:
    code, _, err = leastaction("optimize", two_links, "--out", tmp_path / "x")
    assert code == 2
    assert "got 'mechanism 1', expected 'problem 1'" in err
    assert not (tmp_path / "x").exists()
    code, _, err = leastaction("simulate", PROBLEMS / "cart_pendulum.yaml")
    assert code == 2
    assert "got 'problem 1', expected 'mechanism 1'" in err


def test_commands_are_in_the_order_of_work(leastaction) -> None:
    _, out, _ = leastaction("--help")
    names = ["demo", "optimize", "view", "check", "simulate", "lqr", "info", "convert", "draw", "examples", "bench"]
    places = [out.index(f"│ {name} ") for name in names]
    assert places == sorted(places)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_generated(leastaction, tmp_path: Path, shell: str) -> None:
    file = tmp_path / f"completion.{shell}"
    code, _, err = leastaction("--install-completion", "--shell", shell, "--output", file)
    assert (code, err) == (0, "")
    script = file.read_text(encoding="utf-8")
    for word in ("optimize", "simulate", "convert", "max-iterations"):
        assert word in script
    assert script == app.generate_completion(shell=shell)


def test_what_does_not_move_is_drawn_too(leastaction, tmp_path: Path) -> None:
    assert leastaction("simulate", "cart_pendulum", "--until", 0.1, "--out", tmp_path / "still")[0] == 0
    assert (tmp_path / "still" / "motion.html").exists()


def test_a_first_step_that_cannot_be_made(leastaction, two_links: Path, tmp_path: Path) -> None:
    out = tmp_path / "coarse"
    words = ("simulate", two_links, "--set", "shoulder=2", "--dt", 0.9, "--until", 9, "--out", out, "--json")
    code, text, _ = leastaction(*words)
    facts = json.loads(text)
    assert code == 1
    assert (facts["status"], facts["steps"]) == ("STEP_FAILED", 0)
    assert "too coarse" in facts["message"]
    assert [file.stem for file in out.iterdir()] == ["run"]
    code, text, err = leastaction(*words[:-1])
    assert (code, err) == (1, "")
    assert "too coarse" in text
    (run,) = out.iterdir()
    assert leastaction("view", run, "--out", tmp_path / "coarse.html")[0] == 0
