"""The task `tracking`: does a tracker know where a moving camera is?"""
