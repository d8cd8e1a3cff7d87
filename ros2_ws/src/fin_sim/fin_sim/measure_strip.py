"""Young's modulus of a sheet from a strip of it that a weight bends, with its error, as an entry of a stock."""

from __future__ import annotations

import argparse
import json
import re
import sys
import textwrap
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from fin_plant.command import command
from fin_plant.fin import FIN_PARAMETERS
from fin_plant.units import quantity
from fin_sim.strip import LARGEST_SAG, Measured, modulus_of_strip

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fin_sim.strip import Modulus

_GRAVITY = 9.81
"""m/s^2; it differs by 0.3 % over the Earth, less than a thickness can be measured."""
_WITH_ERROR = re.compile(r"\s*([^\s±+]+?)\s*(?:\+-|±)\s*(\S+?)\s*([A-Za-z]\S*)\s*")
_NOTICEABLE = 1.01
_NARROW = 0.5
"""Width over length up to which a strip bends as a beam, and not as a plate."""
_MEASURES = {
    "length": "from the clamp to the weight",
    "width": "of the strip",
    "thickness": "of the sheet: its error counts three times, so take the mean of many places",
}
_AFTER = """\
Cut a strip some six times as long as wide, clamp one end so that it stands
out level, and hang a weight on the other. Measure by how much the end sinks
when the weight is hung on, so that the strip's own weight does not count.
Values are written with unit and error, the standard deviation of what was
read:

  measure_strip --length "60 +- 0.3 mm" --width "10 +- 0.1 mm" \\
      --thickness "0.300 +- 0.003 mm" --weight "0.5 g" "1 g" \\
      --deflection "6.8 +- 0.2 mm" "13.2 +- 0.2 mm" \\
      --density "1190 kg/m^3" --name offcut
"""


def measured(name: str, text: str, unit: str, *, needs_error: bool = True) -> Measured:
    """Return what a text like ``0.30 +- 0.01 mm`` says, in SI.

    Raises:
        ValueError: No such text, another kind of unit, or no error where one is needed.
    """
    found = _WITH_ERROR.fullmatch(text)
    if found is not None:
        value, error = (quantity(name, f"{part} {found[3]}", unit) for part in (found[1], found[2]))
        return Measured(name, value, error)
    if needs_error or not re.search("[A-Za-z]", text):
        msg = f"{name} = {text!r}: write value, error and unit, for example {name} '10 +- 0.1 mm'"
        if not needs_error:
            msg = f"{name} = {text!r}: write it with its unit, for example {name} '2 g'"
        raise ValueError(msg)
    return Measured(name, quantity(name, text, unit))


def force(text: str) -> Measured:
    """Return the force in N of a weight given in g or N.

    Raises:
        ValueError: It is neither.
    """
    try:
        return measured("weight", text, "N", needs_error=False)
    except ValueError:
        mass = measured("weight", text, "kg", needs_error=False)
        return Measured("weight", mass.value * _GRAVITY, mass.error * _GRAVITY)


def _entry(name: str, found: Modulus, thickness: Measured, density: str | None) -> str:
    """Return the strip's sheet as a line of a stock."""
    entries = {
        "young_modulus": f"{found.value / 1e9:.4g} GPa",
        "spread": f"{found.error / 1e9:.2g} GPa",
        **({} if density is None else {"density": density}),
        "thickness": f"{thickness.value * 1e3:.4g} mm",
    }
    return f"{name}: {{{', '.join(f'{key}: {value}' for key, value in entries.items())}}}"


def _report(found: Modulus, strip: _Strip, name: str, density: str | None) -> str:
    shares = sorted(found.shares.items(), key=lambda each: -each[1])
    wide = strip.width.value / strip.length.value
    lines = [
        f"E = {found.value / 1e9:.4g} +- {found.error / 1e9:.2g} GPa ({100.0 * found.error / found.value:.2g} %)",
        f"the error comes from {', '.join(f'{source} {100.0 * share:.2g} %' for source, share in shares)}",
    ]
    if found.correction > _NOTICEABLE:
        lines.append(
            f"the strip sinks by {found.largest_sag:.2g} of its length: a straight beam's formula would give "
            f"{100.0 * (found.correction - 1.0):.2g} % more there, the elastica was used"
        )
    if found.scatter > 1.0:
        lines.append(f"the readings differ {found.scatter:.2g} times as much as their errors say, and count so")
    if wide > _NARROW:
        lines.append(f"the strip is {wide:.2g} times as wide as long: it bends as a plate, up to a tenth stiffer")
    missing = (
        "its edges (sheet: [210 mm, 297 mm])" if density else "its density, and its edges (sheet: [210 mm, 297 mm])"
    )
    entry = _entry(name, found, strip.thickness, density)
    return "\n".join([*lines, f"as a sheet in a stock, to which you add {missing}:", f"  {entry}"])


@dataclass(frozen=True)
class _Strip:
    """What the command line says of a strip."""

    length: Measured
    width: Measured
    thickness: Measured
    readings: tuple[tuple[Measured, Measured], ...]

    @classmethod
    def given(cls, options: argparse.Namespace) -> _Strip:
        """Read it.

        Raises:
            ValueError: A text that cannot be read, or weights and deflections that do not go together.
        """
        if len(options.weight) != len(options.deflection):
            msg = f"{len(options.weight)} weights and {len(options.deflection)} deflections: give one for each"
            raise ValueError(msg)
        length, width, thickness = (measured(each, getattr(options, each), "m") for each in _MEASURES)
        FIN_PARAMETERS["fin.thickness"].check(thickness.value)
        if options.density is not None:
            FIN_PARAMETERS["fin.density"].check(quantity("density", options.density, "kg/m^3"))
        sunk = [measured("deflection", text, "m") for text in options.deflection]
        return cls(length, width, thickness, tuple(zip(map(force, options.weight), sunk, strict=True)))

    def modulus(self) -> Modulus:
        """Return E.

        Raises:
            ValueError: The strip cannot be measured so, or no fin takes its E.
        """
        found = modulus_of_strip(self.length, self.width, self.thickness, self.readings)
        FIN_PARAMETERS["fin.young_modulus"].check(found.value)
        return found


@command("measure_strip")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, or 2 for what cannot be measured."""
    parser = argparse.ArgumentParser(
        prog="measure_strip",
        description=textwrap.fill(__doc__, 78),
        epilog=_AFTER,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for name, what in _MEASURES.items():
        parser.add_argument(f"--{name}", required=True, metavar="VALUE", help=what)
    parser.add_argument("--weight", required=True, nargs="+", metavar="VALUE", help="in g or N, one or several")
    parser.add_argument(
        "--deflection",
        required=True,
        nargs="+",
        metavar="VALUE",
        help=f"of the weight, one for each; at most {LARGEST_SAG:g} of the length",
    )
    parser.add_argument("--density", metavar="VALUE", help="of the sheet, for its entry in a stock")
    parser.add_argument("--name", default="strip", help="of the sheet in a stock")
    parser.add_argument("--json", action="store_true", help="the numbers as JSON, in SI")
    options = parser.parse_args(arguments)
    strip = _Strip.given(options)
    found = strip.modulus()
    if options.json:
        rest = {name: value for name, value in asdict(found).items() if name not in {"value", "error"}}
        said = {"young_modulus": found.value, "spread": found.error, "units": {"young_modulus": "Pa", "spread": "Pa"}}
        sys.stdout.write(json.dumps({**said, **rest}, indent=1) + "\n")
    else:
        sys.stdout.write(_report(found, strip, options.name, options.density) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
