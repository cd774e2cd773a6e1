"""Force terms by the `kind` that `physics.terms` of a scene file names them by.

Another one is a file here and a row of `TERMS`.
"""

from morphosim.physics.axial_tension import AxialTension
from morphosim.physics.centrifuge import Centrifuge
from morphosim.physics.chemotaxis import Chemotaxis
from morphosim.physics.contractile_ring import ContractileRing
from morphosim.physics.flow import Flow
from morphosim.physics.gravity import Gravity
from morphosim.physics.polarity import Polarity
from morphosim.physics.term import Term
from morphosim.physics.wall_adhesion import WallAdhesion

TERMS: dict[str, type[Term]] = {
    "gravity": Gravity,
    "centrifuge": Centrifuge,
    "flow": Flow,
    "chemotaxis": Chemotaxis,
    "polarity": Polarity,
    "wall_adhesion": WallAdhesion,
    "axial_tension": AxialTension,
    "contractile_ring": ContractileRing,
}
