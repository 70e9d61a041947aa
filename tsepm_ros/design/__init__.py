"""Design of parameters from a data sheet: rules, predictions and the search among them."""
