# SPDX-License-Identifier: Apache-2.0
load "docs/measured/text/style.gp"
set multiplot layout 1,2
set title "joint 1: held-out residual over the phase of order 240.9"
set xlabel "phase, periods"
set ylabel "mean residual, N.m"
plot dir."/folded.dat" using ($1==1 && $3>0 ? $4 : NaN):5 with linespoints pt 7 ps 0.5 lc rgb up title "positive motion", \
     "" using ($1==1 && $3<0 ? $4 : NaN):5 with linespoints pt 7 ps 0.5 lc rgb down title "negative motion"
set title "lines of the held-out residual"
set xlabel "order, periods a joint turn"
set ylabel "amplitude, N.m"
set xrange [0:600]
plot dir."/spectrum.dat" using ($1==1 ? $2 : NaN):3 with lines lc rgb up title "joint 1", \
     "" using ($1==4 ? $2 : NaN):3 with lines lc rgb down title "joint 4", \
     "" using ($1==6 ? $2 : NaN):3 with lines lc rgb grey title "joint 6"
