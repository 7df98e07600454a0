"""What a scene is made of beside land and currents: endpoints, planes, areas, speeds."""
