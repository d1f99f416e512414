"""The thresholds of the search: what each decides, its unit, and what was measured or derived for it."""

PRICE = 17.0
"""Nats that one more edge has to bring: its Occam factor, the prior range over the posterior width in r and theta,
ln(3 m / 0.1 mm) + ln(360 deg / 0.05 deg) less ln(2 pi). A false-alarm rate of 1e-3 over a map of
600 x 360 cells gives 19."""

SEARCH_ORDER = 3
"""Orders 1 and 2 hold a third of the truth's log likelihood in a lossless plate; 3 is what the search can afford."""

FULL_ORDER = 5
"""Orders of reflection that the waveform explains."""

FAR_ORDER = 16
"""Up to this order it is judged what walls leave unexplained, each order as strong as fits best. With coefficients of
0.8 to 0.95 orders 6 to 8 hold 5 to 23 % of the echoes' power (plates of 1 to 2 m, even seeds), in plates of 3 and 4
edges those beyond 5 % and more; the sixteenth is farther than 3 m there."""

FAR_AROUND_CORNERS = 8
"""The same of outlines that are not convex, or have something inside: there the paths of sixteen reflections take forty
times as long as those of five."""

ROUNDS = 20
"""Changes in a row, at most."""

CHORDS = 12
"""Lines proposed at a time to cut the polygon."""

DIFFERENT = 1.0
"""Nats from which a refined trial is another maximum, and not the same one reached from elsewhere."""

ANOTHER_POLYGON = 5.0
"""Nats from which a change by power is another polygon, and not the same one refined again: under a third of an edge's
price."""

LEAST_CHORD = -2.0
"""Nats of first-order evidence from which a cut is tried: at -10 dB a short edge's own feet bring as little, its higher
orders the rest."""

FEW, ENOUGH, SCORED = 3, 20, 12
"""One ping of `FEW` scores all changes first, but `ENOUGH` at least; the best `SCORED` are scored by all pings."""

POOL = 100
"""Candidate lines of a start: random plates have 20 to 60 that bring anything."""

BY_POWER = 0.75
"""Share of the echoes' power that walls explain by power, to be looked at in phase: those of a window, or by the pulse
of minimum phase an outline that is not convex (of four L and T, even seeds, 0.93 to 1, and 0.57 to 0.62 of three wrong
outlines of a T)."""

RING_EXPLAINED = 0.85
"""Share of the echoes' power that a ring explains, by power, from which the waveform is asked at once: of 17 rings of
outlines that are not convex those with all their walls explain 0.88 and more, others 0.56 to 0.91 (even seeds)."""

RING_WORTH = 1.2
"""Times the log likelihood of power that a ring to start from has to be worth of what a convex outline is: under
odometry that drifts, beside a seam or a second mode, and in a wrong medium it is 1.10 times at most (18 scenes), in
outlines that are not convex 1.47 times and more in 17 of 18 (all of even seeds)."""

ANNEALING = 20_000
"""Iterations over subsets of them."""

STRENGTHS = 1.0, 2.0, 4.0, 0.5
"""Factors of the estimated strength of a first-order echo, each of which gives a start: what is too high hides walls,
what is too low proposes clutter."""

COHERENT = 0.2
"""Share of the power's log likelihood below which the waveform's says that phases are not to be trusted. At the
right polygon the waveform is worth 1.1 times the power at 0 dB and twice as much at -10 dB; where positions are off by
5 mm, 0.01 to 0.15, seldom a third (random plates, even seeds). Wrong polygons are worth all between."""

IN_PHASE = 0.4
"""The same share after the single changes that the waveform asks for. Where positions are off by 5 mm, what took to
phases by accident ends at 0.2 to 0.3, with walls lost that power had found; what is right, at 0.7 or more."""

OBVIOUS = 400.0
"""A trial without a wall, or with one half a cycle off, is refitted only if it loses less than this [nats]: the
remaining walls can win back at most a few tens; a wall that is heard is worth thousands."""

WEAK_ECHOES = 0.05
"""Uncertainty of the share explained, by all pings, from which echoes are weak: it is 0.07 to 0.1 in plates at -10 dB,
0.01 at 0 dB."""

ALL_EXPLAINED = 0.98
"""Share of the echoes' power from which nothing is looked for in the rest: the tail of higher orders."""

WORTH_MOVING = 0.5
"""Share of the echoes' power below which an outline that is not convex, or has a hole, is not worth more work. Of 60
that were settled, those that came right explained 0.65 and more to begin with. By power, rings to start from explain
0.60 and more (eight outlines) and outlines with holes 0.73 and more (eight plates), under odometry that drifts 0.14 to
0.43 (six plates, all of even seeds)."""

CORNERS_FROM = 0.5
"""Share of the echoes' power that walls explain from which it is asked what their corners return: there is nothing to
ask of walls that are not there."""

CORNER_ROUNDS = 4
"""How often what corners return is taken out, each time as the walls then stand: with two, walls are a seventh farther
off in deviations, with eight or sixteen as far (nine plates, even seeds)."""

HORIZON_HOLDS = 0.25
"""Share of the echoes' power that has to be nearer than paths of more reflections than the waveform has: in plates that
reflect everything it was 0.4 to 0.5 (three, by the wave equation)."""

HEARD_THROUGH = 0.5
"""Share of the echoes' power that an outline explains in which an inner wall lets waves through: with one that reflects
0.2 to 0.6 of the amplitude it is 0.52 to 0.92 (six plates, even seeds); with a hole, 0.23 to 0.37."""

STILL_LEFT = 0.6
"""Share of what an outline leaves unexplained that may be left beside the first inner wall. Beside the right one
nothing was (six plates, even seeds), and of two the first explains about half; in echoes of a second mode each would
explain a little."""

HOLE_WORTH = 1.5
"""Times the log likelihood of power that an outline with a hole has to be worth of what it is without, and of what one
that is not convex is to be looked at before it: with one of 0.15 to 0.4 m it is 1.7 to 3.1 times, once 8, what it is
without, and no other was worth that (11 plates, even seeds); outlines that are not convex are worth 0.8 to 2.5 times
what a hole in their place is (27, even seeds)."""

HOLES, INNER_WALLS = 3, 3
"""Holes and inner walls that are looked for, at most."""

SILENT = 0.17
"""Reflection coefficient below which a wall takes echoes from others and has none of its own: in the place of a wall
that reflects 0.2 those have 0.02 to 0.14, and the wall itself 0.20 (six plates, even seeds)."""

WHOLE = 0.995
"""Share from which not even an edge as short as the pulse may be missing."""

SHORT_EDGES, CUTS = (1.2, 2.5, 5.0), 10
"""Pulse widths of the edges by which corners are cut off, and how many of these, the best by power, are looked into."""

MISFIT = 0.005
"""Share of the log likelihood that an edge has to bring, where that is more than its price. At the truth it differs by
up to 0.7 % from that of full waveform synthesis, and what is predicted a little wrong, an edge that is not there may
put right. In 36 random plates every edge brings more than 20 %."""

ROUGHER = 0.02
"""The same where what corners return was taken out: what is diffracted twice is left, 1 to 2 % of the power of plates
by the wave equation, and in the place of a sharp corner an edge of two centimetres brought 0.5 % and more."""

EXCHANGED = 2
"""Edges, those worth least, for which all lines are tried."""

SCAN_WIDTHS = 1.25
"""Pulse widths between the lines that are tried: power is smooth over one to each side."""

RESCORED = 300
"""Of these, the best by a few pings, so many are scored by all."""

APART = 2.5
"""Steps of r or of theta by which two of the lines that are scanned differ at least to count as two."""

REFINED = 2
"""Of the trials of a move, the best so many are refined."""

EXPLAINED = 0.95
"""Share of the echoes' power that a polygon has to explain, less three standard deviations of what is measured: the
right polygons of random plates explain 0.97 or more; with S0 10 dB below A0 it is 0.91, and most wrong ones less."""

PHASED = 0.85
"""Share of the echoes' power from which phases of reflections are looked for: real coefficients explain 0.9 and more
where each wall turns the phase by up to 45 degrees."""

IN_VAIN = 0.7
"""Share of the echoes' power below which another cause than walls is asked for before they are changed: in media that
are not even by half a hundredth or a whole one walls explain 0.1 to 0.6, three times of 36 0.74 to 0.88; where echoes
fade at the ends of walls 0.8 (even seeds)."""

EDGE_WORTH = 1.2
"""Times the log likelihood that a law by which edges turn the phase has to be worth where none explains the echoes: a
free edge's, or 90 degrees either way, to which phases of 45 degrees are near enough, is worth two to six times what
real coefficients are (12 plates each, even seeds); where a wall is in the wrong place, any three numbers more gain some
percent."""

ORDERS_WORTH = 1.03
"""Times the log likelihood that strengths of the echoes by order have to be worth: without order 5, which the walls
predict, it is 1.15 times and more (24 plates, even seeds)."""

LOUDNESS_FROM, LOUDNESS_WORTH = 0.7, 1.03
"""Share of the echoes' power that is explained from which a device's directions and a medium's loss are looked for, and
the same of these as of strengths: without any they gained 1.3 % at most, with a directivity of 0.3 or a loss of
0.35 Np/m 7 to 13 %, of 0.90 to 0.98 that were explained (plates of 4, 5 and 8 edges, even seeds)."""

LAW_WORTH = 1.03
"""The same of another law where one explains 0.85 and more: by a pulse of Q 4 of narrow band a plate of free edges is
explained to 0.96 by real coefficients, with walls 2 mm off; the free edge's law is worth 1.09 times as much there."""

EDGE_PRICE, EDGE_MISFIT = 50.0, 0.01
"""Nats that phases of reflections have to bring where the echoes are explained but for a little, and the share of the
log likelihood, where that is more: on scenes without any, and a nominal pulse that is half a microsecond off, they
gained 0.7 % (311 to 406 nats of some 60,000), and moved the walls by 0.2 mm; phases of +-45 degrees by wall gain 2 %.
"""
