"""The public surface, out of what cargo-public-api lists with hidden modules: the items at the crate's root, by their
names there, so that nothing differs when an item moves from one hidden module to another.

cargo public-api ... | public_api.py > reference/public-api.txt
"""

import re
import sys
from pathlib import Path


def at_the_root():
    """Path in its module and name at the root of every item that src/lib.rs exports."""
    text = (Path(__file__).parent.parent / "src/lib.rs").read_text()
    for module, many, one in re.findall(r"(?m)^pub use ([\w:]+)::(?:\{([^}]*)\}|(\w+));", text):
        for name in re.findall(r"\w+", many or one):
            yield f"stickslip::{module}::{name}", f"stickslip::{name}"


def main():
    exported = dict(at_the_root())
    long = re.compile("|".join(rf"{re.escape(path)}\b" for path in sorted(exported, key=len, reverse=True)))
    names = "|".join(map(re.escape, [*exported.values(), "stickslip::Vec3", "stickslip::Mat3"]))
    # The item that a line is about: the first one, or the type that a trait is implemented for.
    about = re.compile(rf"(?:impl.* for |impl[^ ]* |[^:(]*?)({names})\b")
    lines = [long.sub(lambda found: exported[found[0]], line.rstrip()) for line in sys.stdin if not line.startswith("pub use")]
    found = [(about.match(line), line) for line in lines]
    # Within an item the order is that of the tool.
    for _, line in sorted(((match[1], line) for match, line in found if match), key=lambda pair: pair[0]):
        print(line)


if __name__ == "__main__":
    main()
