"""Chapters of the report that serve any instrument: what they compute is by joint, tendon and load."""
