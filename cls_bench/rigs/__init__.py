"""Rigs: what a bench is built of, as a file; what follows from data sheets; what a rig can do."""

from cls_bench.rigs.derivation import Derived
from cls_bench.rigs.figures import Figures, figures
from cls_bench.rigs.modes import Resonances, resonances
from cls_bench.rigs.rig import THESIS, Rig, find_rig, load_rig, parse_rig

__all__ = [
    "THESIS", "Derived", "Figures", "Resonances", "Rig", "figures", "find_rig", "load_rig", "parse_rig", "resonances",
]  # fmt: skip
