"""The functions of `import photoclinometry`: each reads what it is given by path, calls the library, and returns.

Paths are strings or `Path`. Optional arguments go by keyword. Options are given as an object (`options=`), field by
field (`reflectance="mcewen"`), or both: single fields then replace those of the object.
"""
