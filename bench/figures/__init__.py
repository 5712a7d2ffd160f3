"""Figures and tables: each function takes data and gives a picture or a text.

``joints`` (goals against positions), ``gait`` (which foot is down when), ``path`` (the body from
above), ``timing`` (measured against the thesis), ``film`` (frames side by side or as a GIF),
``tables`` (Markdown and plain text), ``style`` (what they share). Nothing needs a display.
"""
