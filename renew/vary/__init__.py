"""Departures, speeds and members of a forecast: functions around the plan of one request."""
