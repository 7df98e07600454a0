"""A voyage by a drift model: times under way and fuel (Eq. 4), and voyages that can't be made."""
