#!/usr/bin/env python3
"""Run a scene with the reference and write its trace: simulate.py SCENE [--network network.json] --out trace.csv"""

import argparse
import json
import sys

from stickslip_reference import cycle, mesh_file, network, scene, trace


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", help="scene file (TOML)")
    parser.add_argument("--network", help="take nodes, masses, fixed, springs and triangles from this network.json")
    parser.add_argument("--out", default="trace.csv", help="trace to write")
    parser.add_argument("--write-network", metavar="PATH", help="also write the network as a network.json")
    arguments = parser.parse_args()
    try:
        read = scene.load(arguments.scene)
        if arguments.network:
            mesh = network.read(arguments.network, read)
        else:
            mesh = mesh_file.network(read) if read["mesh"].kind == "file" else network.block(read)
        run = cycle.run(read, mesh)
    except scene.SceneError as error:
        print(f"simulate.py: {error}", file=sys.stderr)
        return 2
    columns = trace.table(run)
    trace.write(columns, arguments.out)
    if arguments.write_network:
        network.write(mesh, arguments.write_network)
    print(json.dumps(trace.summary(columns, run), indent=1))
    return 1 if run.fault else 0


if __name__ == "__main__":
    sys.exit(main())
