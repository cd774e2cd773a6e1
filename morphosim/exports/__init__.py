"""Files of runs for other programs: ParaView, CAD and printing, image analysis, spreadsheets."""
