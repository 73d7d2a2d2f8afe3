"""The site of the documentation: the pages of docs/, and those that are written here from the code."""
