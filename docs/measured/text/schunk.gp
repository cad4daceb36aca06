# SPDX-License-Identifier: Apache-2.0
load "docs/measured/text/style.gp"
set multiplot layout 1,2
do for [j in "4 3"] {
    set title "joint ".j.": friction of each run over the model's"
    set xlabel "run"
    set ylabel "share"
    set xrange [0:101]
    set yrange [0.6:1.5]
    set arrow 1 from 20.5, graph 0 to 20.5, graph 1 nohead lc rgb "#bbbbbb"
    set arrow 2 from 40.5, graph 0 to 40.5, graph 1 nohead lc rgb "#bbbbbb"
    set arrow 3 from 60.5, graph 0 to 60.5, graph 1 nohead lc rgb "#bbbbbb"
    set arrow 4 from 79.5, graph 0 to 79.5, graph 1 nohead lc rgb "#bbbbbb"
    set arrow 5 from 93.5, graph 0 to 93.5, graph 1 nohead lc rgb "#bbbbbb"
    plot dir."/share.dat" using ($1==j+0 ? $2 : NaN):3:4 with yerrorbars pt 7 ps 0.5 lc rgb up notitle
}
