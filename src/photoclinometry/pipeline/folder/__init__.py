"""The folder of a run: its stages and their keys, who owns it, what it remembers."""
