"""The data card: what a dataset is, for people and for programs.

card: `roundel card`: a dataset's data card, as a record for programs (card.json) and as a page (card.html)
contact_sheet: A contact sheet: some frames of a dataset as small pictures in the page
distributions: Distributions of a dataset's degrees of freedom: counts in even bins, and small plots of them
"""
