"""What a run leaves behind: tables, the 3D view, the report, and messages for other programs.

Import from the modules: `tables` and `journal` (Parquet, and what makes a run resumable), `view`
(rerun), `report`, `detection_report` and its part `camera_report` (HTML), `overlay` (MCAP),
`pictures`, `camera_pictures` and `palette`. This package imports none of them, since some are
heavy.
"""
