"""The cross-check table: reference, quantity, tolerance, measured residual, from what the checks left behind.

table.py FOLDER   reads FOLDER/*.log (lines `RESIDUAL | reference | quantity | tolerance | measured`),
                  FOLDER/python.json (pytest --residuals) and FOLDER/traces/*/reference-comparison.json
"""

import json
import sys
from pathlib import Path


def rows(folder):
    for log in sorted(folder.glob("*.log")):
        for line in log.read_text().splitlines():
            if line.startswith("RESIDUAL |"):
                yield [cell.strip() for cell in line.split("|", 4)[1:]]
    worst = {}
    if (folder / "python.json").exists():
        for row in json.loads((folder / "python.json").read_text()):
            key = row["test"].split("::")[0].removeprefix("test_").removesuffix(".py"), row["quantity"], row["tolerance"]
            worst[key] = max(worst.get(key, row["residual"]), row["residual"])
    for (file, quantity, tolerance), residual in worst.items():
        yield [f"numpy: {file}", quantity, f"{tolerance:.1e}", f"{residual:.1e}"]
    for file in sorted((folder / "traces").glob("*/reference-comparison.json")):
        comparison = json.loads(file.read_text())
        name, largest = max(
            ((name, quantity["scaled"]["max"]) for name, quantity in comparison["quantities"].items()), key=lambda pair: pair[1])
        tolerance = comparison["quantities"][name]["tolerance"]
        rows = comparison["rows"]["trace"]
        yield ["numpy trace", f"{comparison['scene']}: {rows} rows, every quantity; worst {name}, scaled", f"{tolerance:.1e}", f"{largest:.1e}"]


def main():
    table = [["reference", "quantity", "tolerance", "measured"], *rows(Path(sys.argv[1]))]
    widths = [max(len(row[column]) for row in table) for column in range(4)]
    for number, row in enumerate(table):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())
        if number == 0:
            print("  ".join("-" * width for width in widths))


if __name__ == "__main__":
    main()
