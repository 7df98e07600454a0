"""Plans: the best route of a class, class by class, by departure, by speed, and around areas."""
