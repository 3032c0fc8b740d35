"""The cross-check table: reference, quantity, tolerance, measured residual, from what the checks left behind.

table.py FOLDER [--summary FILE] [--failed WHAT]... [--skipped WHAT]...
                  reads FOLDER/*.log (lines `RESIDUAL | reference | quantity | tolerance | measured`),
                  FOLDER/python.json (pytest --residuals) and FOLDER/traces/*/reference-comparison.json;
                  FILE gets the same as JSON with date, version and commit, which `stickslip report` shows
"""

import argparse
import json
import math
import subprocess
import tomllib
from datetime import UTC, datetime
from pathlib import Path

HEAD = ["reference", "quantity", "tolerance", "measured"]


def rows(folder):
    for log in sorted(folder.glob("*.log")):
        for line in log.read_text().splitlines():
            if line.startswith("RESIDUAL |"):
                yield [cell.strip() for cell in line.split("|", 4)[1:]]
    worst = {}
    if (folder / "python.json").exists():
        for row in json.loads((folder / "python.json").read_text()):
            key = row["test"].split("::")[0].removeprefix("test_").removesuffix(".py"), row["quantity"], row["tolerance"]
            known = worst.get(key, row["residual"])
            worst[key] = known if math.isnan(known) or row["residual"] <= known else row["residual"]
    for (file, quantity, tolerance), residual in worst.items():
        yield [f"numpy: {file}", quantity, f"{tolerance:.1e}", f"{residual:.1e}"]
    for file in sorted((folder / "traces").glob("*/reference-comparison.json")):
        comparison = json.loads(file.read_text())
        # A difference that is not finite is written as null, and is the largest.
        largest = {name: math.inf if (most := quantity["scaled"]["max"]) is None else most
                   for name, quantity in comparison["quantities"].items()}
        name = max(largest, key=largest.get)
        tolerance, ticks = comparison["quantities"][name]["tolerance"], comparison["rows"]["trace"]
        yield ["numpy trace", f"{comparison['scene']}: {ticks} rows, every quantity; worst {name}, scaled", f"{tolerance:.1e}",
               f"{largest[name]:.1e}"]


def git(*arguments):
    done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def summary(found, failed, skipped):
    commit = git("rev-parse", "--short=12", "HEAD")
    return {
        "version": tomllib.loads(Path("Cargo.toml").read_text())["package"]["version"],
        "commit": "not told" if commit is None else commit + ("+" if git("status", "--porcelain") else ""),
        "date": datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "passed": not failed,
        "failed": failed,
        "skipped": skipped,
        "rows": [dict(zip(HEAD, row)) for row in found],
    }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--summary", type=Path)
    parser.add_argument("--failed", action="append", default=[])
    parser.add_argument("--skipped", action="append", default=[])
    arguments = parser.parse_args()
    found = list(rows(arguments.folder))
    if arguments.summary:
        text = json.dumps(summary(found, arguments.failed, arguments.skipped), indent=2, ensure_ascii=False)
        arguments.summary.write_text(text + "\n")
    table = [HEAD, *found]
    widths = [max(len(row[column]) for row in table) for column in range(4)]
    for number, row in enumerate(table):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())
        if number == 0:
            print("  ".join("-" * width for width in widths))


if __name__ == "__main__":
    main()
