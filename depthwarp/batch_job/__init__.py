"""Many views of one cloud, drawn into files: what `depthwarp batch` does, without the command line.

`read_views` says from where and through which lenses; a `PngFolder`, an `NpzFile` or a `ZarrStore`
is what comes about; `draw_batch` draws the views that are not there yet. A batch survives a kill or
a power cut at any moment: a view counts when its line is in the journal, and the line is written
when its files are on the disk.
"""
