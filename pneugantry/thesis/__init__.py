"""The thesis' tables and conclusions, run on the FMU and put beside what is printed."""
