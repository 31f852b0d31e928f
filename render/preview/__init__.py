"""A study before it is rendered: some of its frames, small and with few rays, and what they show.

frame_facts: What a frame shows: the size of its markers, their distances, the field of view
frame_selection: Which frames a preview renders: spread over the groups, within a cost
group_facts: What a group shows: ranges over some of its frames, its light, what is drawn from which distribution
page: The page of a preview, and its contact sheet as one picture
preview: Preview a study: render a few small frames, write the page and the contact sheet, summarise each group
small_frame: A frame at the size of a thumbnail: the same scene with fewer and larger pixels, and few rays
"""
