"""The league: every related system on the same images, as a page and as data.

entries: Entries of the league: a method with its prior knowledge, and the variants of the study whose markers it reads
figure: The league at one glance: cells of entries by conditions, shaded by how good they are, with the best marked
held_back: A held-back part of the league: images anyone may solve, whose truth stays with the organiser
league: The league's page: outcomes of every entry to league.html, figures, tables, league.json and outcomes.parquet
outcomes: Outcomes of the league: for each frame of an entry, whether the marker was found, what it says, and the errors
standings: Standings of the league: rates and errors of each entry, over all conditions and by condition, with intervals
submission: A submission to the league: estimates of an outside method, checked, and scored like every other entry
tables: Tables of the league: overall, by condition, focal lengths by distance, and who wins where
"""
