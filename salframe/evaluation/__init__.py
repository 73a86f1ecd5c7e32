"""Evaluation of methods: requests, runs, tasks, metrics, tables and reports."""
