"""Navigation in closed loop (method.md 6): look, localize, turn towards the next node, walk; walls and wrong answers
are real."""
