"""The pages: one report, or several compared.

compare: `roundel compare`: one page over several reports, paired by frame where they share a dataset
html: HTML pages from templates; all text from users is escaped
report: report.html: a self-contained page without scripts or external files
same_radiance: Reports of datasets with the same radiance: developed (re-exposed) for several sensors
summary_text: Summary text of a report
"""
