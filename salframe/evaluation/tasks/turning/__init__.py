"""The task `turning`: does the proposed turn of a camera help to localize it?"""
