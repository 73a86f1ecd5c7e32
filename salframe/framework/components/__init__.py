"""Components: how they are registered, named, configured, chosen and identified."""
