"""Runs of shipped scenes: the same as the program's, to the bit."""

import csv
import json
import pickle
import subprocess

import numpy as np
import pytest
import stickslip


@pytest.mark.parametrize("name", ["fig5-stick-slip", "deep-stick-slip-faceted"])
def test_trace_and_summary_are_those_of_the_program(program, tmp_path, name):
    """One scene completes, the other ends in a fault."""
    result = stickslip.run(stickslip.Scene.shipped(name))
    done = subprocess.run([program, "run", name, "--quiet", "--out", tmp_path], stdin=subprocess.DEVNULL)
    assert done.returncode in (0, 1, 3)

    with open(tmp_path / "trace.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert list(result.trace) == header
    for name, column in result.trace.items():
        cells = [row[header.index(name)] for row in rows]
        if column.dtype == np.float64:
            expected = np.array([float(cell) if cell else np.nan for cell in cells])
            assert column.tobytes() == expected.tobytes(), name
        elif column.dtype == np.int64:
            assert column.tolist() == [int(cell) if cell else -1 for cell in cells], name
        else:
            assert column.tolist() == cells, name

    summary = json.loads((tmp_path / "summary.json").read_text())
    # Of a run without files.
    apart = {"wall_time_s", "files"}
    assert {k: v for k, v in result.summary.items() if k not in apart} == {
        k: v for k, v in summary.items() if k not in apart
    }
    assert result.fault == summary["fault"]


def test_result_in_other_shapes():
    scene = stickslip.Scene.shipped("fig3-sliding").with_keys(duration=0.2)
    result = stickslip.run(scene)
    assert result.forces.shape == (scene.tick_count, 3)
    assert (result.forces[:, 2] == result.trace["fz"]).all()
    frame = result.to_pandas()
    assert list(frame) == list(result.trace) and len(frame) == 200
    # Columns can be worked on in place.
    result.trace["fn"] *= 1e3
    again = stickslip.run(pickle.loads(pickle.dumps(scene)))
    assert again.trace["fz"].tobytes() == result.trace["fz"].tobytes()


def test_real_time_is_refused():
    scene = stickslip.Scene.shipped("fig5-stick-slip").with_keys({"run.schedule": "threads"})
    with pytest.raises(ValueError, match="virtual time"):
        stickslip.run(scene)
