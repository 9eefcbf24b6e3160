"""Functions that draw arrays with matplotlib's object interface (and one builder of plotly figures).

They take plain arrays, a figure or an axes, and touch nothing else: no `pyplot`, no window, no file except
in `canvas.save_figure`. Colours and line styles live in `style`, figures and their files in `canvas`.
"""
