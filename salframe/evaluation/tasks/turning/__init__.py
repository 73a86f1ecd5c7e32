"""The task `turning`: does the suggested turn of a camera help to localize it?"""
