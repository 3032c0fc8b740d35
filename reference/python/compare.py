#!/usr/bin/env python3
"""Compare runs' whole traces with the reference: exit 0 if all are within tolerance, 1 beyond it, 2 on bad input."""

import argparse
import json
import os
import sys
import traceback
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from stickslip_reference import comparison, cycle, mesh_file, network, scene, trace


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="+", metavar="SCENE", type=Path, help="scene file (TOML)")
    parser.add_argument("--runs", metavar="DIR", type=Path,
                        help="directory of the runs of all scenes, each in one named as its scene's file")
    alone = parser.add_argument_group("one scene alone")
    alone.add_argument("--run", metavar="DIR", type=Path, help="directory of the run (default: reports/<scene name>)")
    alone.add_argument("--trace", type=Path, help="its trace (default: DIR/trace.csv)")
    alone.add_argument("--network", type=Path, help="its network (default: DIR/network.json)")
    alone.add_argument("--out", metavar="DIR", type=Path, help="where to write the comparison (default: the run's directory)")
    arguments = parser.parse_args()
    files = {"folder": arguments.run, "trace_file": arguments.trace, "network_file": arguments.network, "out": arguments.out}
    if arguments.runs is not None and not any(files.values()):
        return compare_all(arguments.scenes, arguments.runs)
    if arguments.runs is not None or len(arguments.scenes) > 1:
        parser.error("several scenes need --runs, and --run, --trace, --network and --out are for one without it")
    status, text = attempt(arguments.scenes[0], **files)
    print(text, file=sys.stderr if status == 2 else sys.stdout)
    return status


def compare_all(scenes, runs):
    """As many at a time as there are cores, told in the order of `scenes`. An error in one changes nothing for others."""
    statuses = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        attempts = [(path, pool.submit(attempt, path, runs / path.stem)) for path in scenes]
        for path, made in attempts:
            try:
                status, text = made.result()
            except Exception as error:  # a process was killed, and with it all that were left
                status, text = 2, f"compare.py: {error}"
            statuses.append(status)
            print(f"{path}\n{text}\n", flush=True)
    for path, status in zip(scenes, statuses):
        if status != 0:
            print(f"{path}: {'differs' if status == 1 else 'could not be compared'}")
    print(f"{statuses.count(0)} of {len(statuses)} traces are those of the reference")
    return max(statuses)


def attempt(*arguments, **files):
    """Exit status and text of one comparison, whatever happens in it."""
    try:
        verdict = compare(*arguments, **files)
        return 0 if verdict["pass"] else 1, "\n".join(comparison.table(verdict))
    except scene.SceneError as error:
        return 2, f"compare.py: {error}"
    except Exception:
        return 2, traceback.format_exc()


def compare(scene_file, folder=None, trace_file=None, network_file=None, out=None):
    read = scene.load(scene_file)
    folder = folder or Path("reports") / read.name
    mesh = network.read(network_file or folder / "network.json", read)
    if read["material"].young_modulus is not None or read["material"].damping_ratio is not None:
        network.check_material(mesh, read)
    if read["mesh"].kind == "file":
        mesh_file.check_same(mesh_file.network(read), mesh)
    actual = trace.read(trace_file or folder / "trace.csv")
    run = cycle.run(read, mesh)
    expected = trace.table(run)
    allowed = comparison.tolerance(read["contact"])
    found = comparison.differences(expected, actual, mesh.triangles, [row.result.at for row in run.rows], allowed)
    verdict = {"scene": read.name, "fault": run.fault}
    verdict |= comparison.judge(found, len(expected["t"]), len(actual["t"]), allowed)

    out = out or folder
    out.mkdir(parents=True, exist_ok=True)
    comparison.write_differences(found, out / "reference-differences.csv")
    (out / "reference-comparison.json").write_text(json.dumps(verdict, indent=1, allow_nan=False) + "\n")
    return verdict


if __name__ == "__main__":
    sys.exit(main())
