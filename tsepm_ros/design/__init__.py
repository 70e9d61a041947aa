"""Parameters from a data sheet: rules, predictions and the search among them."""
