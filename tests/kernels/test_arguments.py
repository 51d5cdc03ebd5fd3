"""Few kernels take more than ten arguments: arrays that belong together come as one record."""

from __future__ import annotations

import ast
from pathlib import Path

KERNELS = Path(__file__).resolve().parents[2] / "engine" / "kernels"
MOST = 10
# Kernels that may take more, with the reason. At most ten.
ALLOWED = {
    "background/intersect_llvm.intersect1": "Embree's function, and a ray's numbers",
    "background/intersect_numpy.intersect1": "the same",
}


def arguments_of_kernels() -> dict[str, int]:
    """Number of arguments of each kernel, whether it is decorated or passed to a decorator by name."""
    found = {}
    for path in sorted(KERNELS.rglob("*.py")):
        name = str(path.relative_to(KERNELS))[: -len(".py")]
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                found[f"{name}.{node.name}"] = len(arguments) - (bool(arguments) and arguments[0].arg == "typingctx")
    return found


def test_few_kernels_take_more_than_ten_arguments():
    counts = arguments_of_kernels()
    assert len(counts) > 300
    assert counts["rendering/shade.shade"] == 8
    many = {name for name, count in counts.items() if count > MOST}
    assert many <= set(ALLOWED), "group what belongs together (see rendering/records.py), or say why not"
    assert all(counts[name] > MOST for name in ALLOWED), "these take fewer by now"
    assert len(ALLOWED) <= 10
