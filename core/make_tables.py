"""Write core/entropy/tables.hpp: the tables of the range coder, as integers that every machine has alike.

``python core/make_tables.py``. The specification defines the values; none of them is within 1e-5 of a tie before
rounding.
"""

from __future__ import annotations

from decimal import ROUND_HALF_EVEN, Decimal, getcontext
from pathlib import Path

LOGISTIC_LIMIT = 2047
"""Largest magnitude of log odds [1/256]: three thousand to one."""

RAREST = 32
"""Least probability of either bit [1/65536]: no bit costs more than 11 bits."""

HEADER = Path(__file__).parent / "entropy" / "tables.hpp"

PER_LINE = 16
"""Numbers of a table, in a line of the header."""


def rounded(value: Decimal) -> int:
    return int(value.to_integral_value(ROUND_HALF_EVEN))


def array(kind: str, name: str, comment: str, values: list[int]) -> str:
    lines = [", ".join(map(str, values[at : at + PER_LINE])) for at in range(0, len(values), PER_LINE)]
    body = ",\n    ".join(lines)
    return f"// {comment}\ninline constexpr {kind} {name}[{len(values)}] = {{\n    {body}}};\n"


def main() -> None:
    getcontext().prec = 40
    two = Decimal(2).ln()
    exact = [Decimal(65536) / (1 + (-Decimal(x) / 256).exp()) for x in range(-LOGISTIC_LIMIT, LOGISTIC_LIMIT + 1)]
    squash = [min(max(rounded(probability), RAREST), 65536 - RAREST) for probability in exact]
    half = Decimal("0.5")
    stretch = [rounded(256 * ((p + half) / (Decimal("4095.5") - p)).ln()) for p in range(4096)]
    costs = [rounded(-65536 * ((p + half) / 4096).ln() / two) for p in range(4096)]
    parts = [
        "// Tables of the range coder. Written by core/make_tables.py; clang-format leaves them alone.\n#pragma once\n",
        "// clang-format off\nnamespace pdeanim::tables {\n",
        f"inline constexpr int logistic_limit = {LOGISTIC_LIMIT};  // largest magnitude [1/256]\n",
        f"inline constexpr int rarest = {RAREST};  // least probability of either bit [1/65536]\n",
        array("unsigned short", "squash", "Logistic domain to probability [1/65536], none below the least.", squash),
        array("short", "stretch", "Probability [1/4096] to the logistic domain [1/256].", stretch),
        array("int", "costs", "Cost of a bit of a probability [1/4096], in 1/65536 of a bit.", costs),
        "}  // namespace pdeanim::tables\n",
    ]
    HEADER.write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
