"""Files on the disk: the store of artefacts, its pruning, locks, the folder of results."""
