"""What must not grow, crash or be believed: a million steps, many instances, calls in any order
under the sanitizers, damaged files of every kind that is read.
"""
