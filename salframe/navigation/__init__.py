"""Navigation in closed loop (docs/how-to/navigate.md#what-the-agent-knows-and-does): look, localize, turn towards the
next node, walk; walls and wrong answers are real."""
