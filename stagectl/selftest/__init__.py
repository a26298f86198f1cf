"""Each fault of the table in each state of the axis, in virtual time: whether it stops, how soon, how far away."""
