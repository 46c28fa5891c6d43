"""What pages of runs, comparisons, differences, sweeps and identifications are made of.

A page is a description: its words, tables and charts, in order. `document` has the pieces of HTML
and the shell around them, `chart` what a chart over time holds, `samples` the numbers that its
script draws, `picture` the same charts as an SVG file, and `script` what draws and is pressed.
"""
