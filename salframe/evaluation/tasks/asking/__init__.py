"""The task `asking`: does a description in words find its room?"""
