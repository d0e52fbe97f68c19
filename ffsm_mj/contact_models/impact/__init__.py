"""Impacts: time of impact, impact laws, friction at impacts, the record of an impact."""
