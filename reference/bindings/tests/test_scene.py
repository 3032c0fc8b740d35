"""Scenes: keys, dictionaries, and what is refused."""

import re
import subprocess

import numpy as np
import pytest
import stickslip

FIG5 = "fig5-stick-slip"


def test_keys_change_what_they_name_and_keep_the_text():
    scene = stickslip.Scene.shipped(FIG5)
    changed = scene.with_keys({"contact.friction": np.float64(0.5), "local.rings": np.int64(2)}, duration=0.25)
    assert (changed.tick_count, scene.tick_count) == (250, 1200)
    assert (changed.duration_s, changed.tick_s, changed.name) == (0.25, 1e-3, FIG5)
    comments = [line for line in scene.toml.splitlines() if line.startswith("#")]
    assert comments and all(line in changed.toml for line in comments)
    assert changed.with_keys({"contact.friction": 1.0, "local.rings": 1}, duration=1.2).toml.count("friction") == (
        scene.toml.count("friction")
    )
    # A table that the text lacks, and its removal.
    timed = scene.with_keys({"sync.latency_ticks": 10})
    assert "latency_ticks = 10" in timed.toml
    assert "latency_ticks" not in timed.with_keys({"sync.latency_ticks": None}).toml


def test_changes_are_read_together():
    """Under the velocity scheme, keys of the geometric one are refused."""
    scene = stickslip.Scene.shipped(FIG5)
    with pytest.raises(stickslip.SceneError, match="`contact.[a-z]+` has no effect"):
        scene.with_keys({"contact.scheme": "velocity"})
    scene.with_keys({"contact.scheme": "velocity", "contact.deformation": None, "contact.metric": None})


def test_a_dictionary_means_what_its_text_means(tmp_path):
    tomllib = pytest.importorskip("tomllib")
    scene = stickslip.Scene.shipped(FIG5)
    built = stickslip.Scene.from_dict(tomllib.loads(scene.toml))
    file = tmp_path / "built.toml"
    file.write_text(built.toml)
    traces = [stickslip.run(scene.with_keys(duration=0.3)).trace for scene in (scene, built, scene.from_file(file))]
    assert traces[0]["t"].shape == (300,)
    for name in traces[0]:
        assert len({trace[name].tobytes() for trace in traces}) == 1, name


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("friction = 1.0", "friction = -1.0"),
        ("friction = 1.0", "frictoin = 1.0"),
        ("duration = 1.2", "duration = 'long'"),
        ("0.002]", "-0.002]"),  # found when the run starts: the tip is inside
    ],
)
def test_errors_are_those_of_the_program(program, tmp_path, old, new):
    text = stickslip.Scene.shipped(FIG5).toml
    assert old in text
    file = tmp_path / "bad.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(stickslip.SceneError) as caught:
        stickslip.run(stickslip.Scene.from_file(file))
    error = caught.value
    done = subprocess.run(
        [program, "run", file, "--out", tmp_path / "out"], capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    assert done.returncode == 2
    # The program wraps lines and draws a frame.
    printed = re.sub(r"[\s│]+", " ", done.stderr)
    assert f"{file}:{error.line}:{error.column}]" in printed.replace(" ", "") or (
        f"bad.toml:{error.line}:{error.column}]" in printed
    )
    for words in (error.message, error.help):
        assert words is None or re.sub(r"\s+", " ", words) in printed
    assert error.file == str(file)
    assert error.source_line in file.read_text().splitlines()
    assert str(error).startswith(f"{file}:{error.line}:{error.column}: {error.message}\n")


def test_an_error_in_a_change_names_the_change():
    with pytest.raises(stickslip.SceneError, match="unknown field `frictoin`") as caught:
        stickslip.Scene.shipped(FIG5).with_keys({"contact.frictoin": 1.0})
    error = caught.value
    assert (error.file, error.source_line) == ("change", "contact.frictoin=1.0")
    assert str(error).splitlines()[2] == "            ^^^^^^^^", "under the key"


def test_what_is_no_scene():
    with pytest.raises(ValueError, match="fig5-stick-slip"):
        stickslip.Scene.shipped("fig6")
    with pytest.raises(stickslip.SceneError, match="cannot read") as caught:
        stickslip.Scene.from_file("no-such-file.toml")
    assert caught.value.line is None
    with pytest.raises(TypeError, match=r"`contact.friction` cannot be of type object"):
        stickslip.Scene.shipped(FIG5).with_keys({"contact.friction": object()})
    with pytest.raises(ValueError, match="`contact..friction` is no key"):
        stickslip.Scene.shipped(FIG5).with_keys({"contact..friction": 0.5})
    with pytest.raises(TypeError, match="from_toml"):
        stickslip.Scene()
