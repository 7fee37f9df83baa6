"""The measured axis EMPS: rungs of a friction model beside the published ones, and what the
diagnosis finds by itself
"""
