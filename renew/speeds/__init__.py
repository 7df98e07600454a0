"""How fast: least fuel to be there in time, where the vessel chooses her speed."""
