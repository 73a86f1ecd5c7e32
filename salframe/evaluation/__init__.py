"""Methods side by side: a request, a run, one runner, one module a task, metrics and report."""
