"""Output for other readers: the report and the exports."""
