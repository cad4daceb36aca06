# SPDX-License-Identifier: Apache-2.0
load "docs/measured/text/style.gp"
set multiplot layout 1,2
set title "joint 2: held-out residual over the phase of its strongest line"
set xlabel "phase, periods"
set ylabel "mean residual, N.m"
plot dir."/folded.dat" using ($1==2 && $3>0 ? $4 : NaN):5 with linespoints pt 7 ps 0.5 lc rgb up title "positive motion", \
     "" using ($1==2 && $3<0 ? $4 : NaN):5 with linespoints pt 7 ps 0.5 lc rgb down title "negative motion"
set title "lines of the held-out residual"
set xlabel "order, periods a motor turn (N = 101)"
set xtics 0,2,20
set ylabel "amplitude, N.m"
set xrange [0.5:21]
set yrange [0:1.5]
plot dir."/spectrum.dat" using ($1==2 ? $2/101 : NaN):3 with lines lc rgb up title "joint 2", \
     "" using ($1==3 ? $2/101 : NaN):3 with lines lc rgb down title "joint 3", \
     "" using ($1==1 ? $2/101 : NaN):3 with lines lc rgb grey title "joint 1"
