"""The control laws of task files: each one object in one file, with all that is known of it.

A law is added by a module with a registered class, imported here or before the language is. Reading
a file needs no numerical library, so a law's module imports none.
"""

# The order in which laws are listed.
# isort: off
from taskspec.laws.impedance import Impedance
from taskspec.laws.impedance_natural import ImpedanceNatural
from taskspec.laws.pd import PD
from taskspec.laws.pd_joint import PDJoint
from taskspec.laws.stiffness import StiffnessControl
from taskspec.laws.parallel import Parallel
from taskspec.laws.parallel_pid import ParallelPID
from taskspec.laws.hybrid import Hybrid
from taskspec.laws.hybrid_multipliers import HybridMultipliers
from taskspec.laws.hybrid_reaction import HybridReaction
from taskspec.laws.admittance import Admittance
from taskspec.laws.force_velocity import ForceVelocity
from taskspec.laws.hybrid_velocity import HybridVelocity
# isort: on

from taskspec.laws.law import LAWS, ControlLaw, register

#: The law of a file that names none, by what laws command. Under both an axis moves, yields or
#: follows a force as its mode says, and a force is reached whatever the stiffness is.
DEFAULTS = {"torque": Hybrid.kind, "velocity": Admittance.kind}

__all__ = [
    "DEFAULTS",
    "LAWS",
    "PD",
    "Admittance",
    "ControlLaw",
    "ForceVelocity",
    "Hybrid",
    "HybridMultipliers",
    "HybridReaction",
    "HybridVelocity",
    "Impedance",
    "ImpedanceNatural",
    "PDJoint",
    "Parallel",
    "ParallelPID",
    "StiffnessControl",
    "register",
]
