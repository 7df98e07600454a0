"""What several formats share: the run's result, legs, figures along a route, text."""
