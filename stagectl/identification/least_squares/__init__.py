"""Moving mass, viscous and Coulomb friction and offset by linear least squares; `method` is where it begins."""
