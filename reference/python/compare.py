#!/usr/bin/env python3
"""Compare a run's whole trace with the reference: exit 0 within tolerance, 1 beyond it, 2 on bad input."""

import argparse
import json
import sys
from pathlib import Path

from stickslip_reference import comparison, cycle, mesh_file, network, scene, trace


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", help="scene file (TOML)")
    parser.add_argument("--run", metavar="DIR", help="directory of the run (default: reports/<scene name>)")
    parser.add_argument("--trace", help="its trace (default: DIR/trace.csv)")
    parser.add_argument("--network", help="its network (default: DIR/network.json)")
    parser.add_argument("--out", metavar="DIR", help="where to write the comparison (default: the run's directory)")
    arguments = parser.parse_args()
    try:
        return compare(arguments)
    except scene.SceneError as error:
        print(f"compare.py: {error}", file=sys.stderr)
        return 2


def compare(arguments):
    read = scene.load(arguments.scene)
    folder = Path(arguments.run or Path("reports") / read.name)
    mesh = network.read(arguments.network or folder / "network.json", read)
    if read["material"].young_modulus is not None or read["material"].damping_ratio is not None:
        network.check_material(mesh, read)
    if read["mesh"].kind == "file":
        mesh_file.check_same(mesh_file.network(read), mesh)
    actual = trace.read(arguments.trace or folder / "trace.csv")
    run = cycle.run(read, mesh)
    expected = trace.table(run)
    found = comparison.differences(expected, actual, mesh.triangles, [row.result.at for row in run.rows])
    verdict = {"scene": read.name, "fault": run.fault} | comparison.judge(found, len(expected["t"]), len(actual["t"]))

    out = Path(arguments.out) if arguments.out else folder
    out.mkdir(parents=True, exist_ok=True)
    comparison.write_differences(found, out / "reference-differences.csv")
    (out / "reference-comparison.json").write_text(json.dumps(verdict, indent=1, allow_nan=False) + "\n")
    print("\n".join(comparison.table(verdict)))
    return 0 if verdict["pass"] else 1


if __name__ == "__main__":
    sys.exit(main())
