"""From fits to an answer: names, intervals, localisation, what stays unexplained."""
