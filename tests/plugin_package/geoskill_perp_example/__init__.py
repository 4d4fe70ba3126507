"""Plug-ins of geoskill, one of each kind."""
