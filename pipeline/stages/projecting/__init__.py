"""Parts of a scene beside land and currents: endpoints, planes, areas, speeds."""
