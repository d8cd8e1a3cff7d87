"""A report of a study as one HTML file that needs nothing else: facts in, a page out; nothing here writes a file.

study_facts     what a study tells of itself
simulated       what the simulator says of the same candidates, kept beside the study
film            a swim as a drawing that moves
study_page      the page of a study
campaign_page   the page of a campaign
space_campaign_page  of one over the space of a file
comparison_page the page of several studies
study_figures   the plots of one study, as plotly's data
several_figures those of several studies and of a campaign's runs
marks           what plots are made of: axes, points, lines
parts           what a page is made of
transfer        how far simulated speeds carry over to measured ones, as numbers
page            the file: `page.html.jinja` filled in, with `page.css`, `page.js` and plotly's own bundle
"""
