"""Plan the best route of a class, of all classes, by departure, by speed, and around areas."""
