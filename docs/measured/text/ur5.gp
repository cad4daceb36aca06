# SPDX-License-Identifier: Apache-2.0
load "docs/measured/text/style.gp"
set multiplot layout 1,2
set xlabel "order, periods a motor turn (N = 101)"
set xtics 0,2,20
set ylabel "amplitude, N.m"
set xrange [0.5:21]
set yrange [0:*]
set title "lines left on the held-out third, joints 1 to 3"
plot dir."/spectrum.dat" using ($1==2 ? $2/101 : NaN):3 with lines lc rgb up title "joint 2", \
     "" using ($1==3 ? $2/101 : NaN):3 with lines lc rgb down title "joint 3", \
     "" using ($1==1 ? $2/101 : NaN):3 with lines lc rgb grey title "joint 1"
set title "joints 4 and 5"
plot dir."/spectrum.dat" using ($1==4 ? $2/101 : NaN):3 with lines lc rgb up title "joint 4", \
     "" using ($1==5 ? $2/101 : NaN):3 with lines lc rgb down title "joint 5"
