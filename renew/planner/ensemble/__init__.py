"""Which class is best in an ensemble of currents, how sure that is, and a lower bound."""
