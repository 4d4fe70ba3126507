"""Scoring a skill against labelled regions."""
