"""The ANFIS friction model of the z axis as trained by `studies.thesis.anfis_study`: three memberships of five inputs, 243 rules."""

import base64
import zlib

import numpy as np

from controllers.anfis import AnfisModel

INPUTS, MEMBERSHIPS = 5, 3


def trained_model() -> AnfisModel:
    """Unpacked anew at each call: a model's arrays are nobody else's."""
    flat = np.frombuffer(zlib.decompress(base64.b85decode(PACKED)), dtype="<f4").astype(np.float64)
    n, m = INPUTS, MEMBERSHIPS
    sizes = np.cumsum([n * m, n * m, m**n * (n + 1), n])
    centre, width, consequent, middle, half = np.split(flat, sizes)
    return AnfisModel(centre.reshape(n, m), width.reshape(n, m), consequent.reshape(-1, n + 1), middle.copy(), half.copy())


PACKED = (
    r"c-kG8cR1DU1ICGrN~p*lS;s6Z=bZ0&o<l?`(JP@+8BL|qq9ijyS#8M(k@QBL@tvo#q9_d`ib&&4N=t)Z*YE!G{`<b}>+_j9naJ#dFA-<0crY-O!YD4@Au&Nx!KN1p"
    r"jCGJadX1Y5Qu-4ZiHkg%#7hRB)KeMPs%*YNNGdRQeT^@%mjiO^Ch?+04Y*gCEI1N$2iMGbgGZ>1<J}&8xMj*4+*)QFFMxeGclupCzgHG;TyNt(losrJ(gtE%OF`hz"
    r"VqmU30InXM&vI!FJoZZ-ez>m%)Q9E(w>Eh=$HAO^V4f!4_)iz{2$+#0xu&GKa}LpvCyP>np3vDy4t@jO0KNGPe4Awm1JpLNu3JyQc?YJ$F5wK=v1K|;8MTJDhl^PU"
    r"+c^H{;kCq#Ur)q_4)?|0Dz7ARz8VO1cM<B*T!yUruL;Rz>XADE82ZX#CwXg3gm$c-i5S&SMI#*L(f?j9Lfb~<DF=1V!ou0cLW4U!!o=tvVZ_0bo6IdO(H?I%s8u)t"
    r"&OCe!OoJYQL=PQ!SZ^b1Ey{pZr<Gw}n=)ilmEe&s4*b?u$dZLAd?J1gA@_+8_s*{s_tS%t-KJ{D%auo<zP$`g+&dLEWXVC>&<Ln2Jj1T*?1Q^r6Ts|+BMcg|hc{yP"
    r"!Zl0hO5H-jC0h%*L|*KDB0=>&@k8m8c*Bfygju5pvch;2TVg+lraLrf`|Zo{q@}sE;<{UytLkFh@KhOnMOaRI+)l&YbbJ}V`PTe(UTb*gm$ZnbdadG$JIXx0BxORH"
    r"%ta3~dC1zM6tXT`g6#9QLo>}n$gqJMX#NR(<dC}zx-ISxB6|==)q7;9UE7=%ws8%F&*Zv=Ol_BNa(U0qltFD#POd%@cmFlE?VcJP5HgF-*ye#Vf)n(9@0*x^oCmHs"
    r"y_9~+xlFHRQ}LRW%b7=*HDBtuns>*xSzPt2Sv=S!$LrTnCj93N5GIq_xSX#VoyV%v+SQA3>}WE*)v^}bm^=&1zHyjpd=XD=AZFnuI>oe_PK4NGBA)j$;gi_N?UOjP"
    r"HB>n7o}ENZ^&=>kwt~xQQe3Z7g7**91BuQ%=2mHxK(Ky0TYp7Qx^a!3)b8>O_WY0Y%(tOnCVH+aJfv#KZoY2F#+~d3ZHg$Ai(CZ*zZk&e*88A$Sqpf#SOacR+{YHx"
    r"`v}<D8Ych1L&$hPgn`F3ne38DR@-7P)_CX`SbN2ssdwQp`@ii4QBlc2n0^5r>Q6>5KoTjqD@0b*96@77KavOQM$k0JKa%b!TPmx{mMZ5yk^GDvpnAi)_#4uuA;LNH"
    r"h-VxVA_P-I9E%=H&hPPsRgt<dm~H~8%NsyiyE<&ui(-TK`v~f*>X=XK9>N@_hY*AsF_B*;SoXaKCS}q=#JClclx4&CABX|-G}FMYx|=ZORX&V;I0Xg;%fKW5Wx@=O"
    r"tn^{|03-|tDE90)`$OX=Yd=2|b^2N<UHWeoUOcf9Y_&ug-7<{%?C%ejJ)epH^I-rpU4I7e{Qzl>mm9rTCKFfWXfuYMESPS_VykOSn7_kk)V>yAD|*t{O4%SxsRbv@"
    r"^RJQfjcUk-!Bafj?{f5}-aOQL?Gbc!?7s-Ruo}6bz6Vv<Fi7^zeveMO6G;3{wxz6vw$!ygCt}g?OUfbOG5?>cSxBJ3f@s^wA@-DLAupwb#P3KSMtJArBP%ibR574e"
    r"d`rWP95k5-br$Hh6=7)fJSN%JgvorKjCJfwV^#J9VY6fHh*{;=$Q#Zz<e9V?{Hh8$dXa0d#9YQ1Z*MoJU9>o~0%n2FpH)adlK)DH>t<qK_k=PlszVupO)gfiP{CM#"
    r"qj;r+5&>+7$$R)PIX=Ha^r75|5_Yzre5IXa1GNg3@B+{vxQI}25t2(^nbXQPkC>#CNoK~slZ=(VEZoTTghOUe>8z)_@s_j88KVgwMyB%wSXI{#mhW1GZWSjHTeTF?"
    r"Y)3_OUssQ0rnL>(eex6)XCVL~$!UxuH=TJ~a}L}w83eT@>db*z@nGz5Bm*LMGNfWDC>rbr@%uzByHd^xw;ZSv`hTtz>RSd1%dh8)emH#NJ7%gQ?dH1(6MQ#O#n(p4"
    r"Ja<Z3Eoe!Y2?ud=G9p$L8WVdW)*`B9iAd(qA~fq+64AU_5hW58(SL%wB|8}#GJ4t->H#ePW=_YMBX5o~KV2_?f1`%M_Jebn6-yJrKAqhRqZ!S-x2^#0`(A*Ltt|-E"
    r"S3sQ8bSCQLoQQicfJlyuA#Y2s;R=T~0c;|hag^pTkL-4UtF{_oe7!PLt(XLIGs2k##haL@-<QGDbuHj@j6dJ#><#hWrPsyf3fINsM1<JWSBH>!lYqVQTt-Gajga*v"
    r"BczY63IXq%(LA;QNr|);dtLm(k9GLS-z{?<`J=Ii->FWz%zk`U$j+=3o=m$UtUj|^_^acTi1&Gff9|LT;_zo5k*s%si2Y`O911`sxK*=c_^BhZb$~<Q;Z}r!{dNT2"
    r"I*z1M{``YRwPI`Wb@8Fy*TwC3Hi>)kbcip?iCE0}<)pv<2>B#)gv@?6l{j_Uj5hvOh%DG~K*T=z$!}ixl`qyQM#}f*^F<l*;t%VM#Iw`&C95{;OS<|g(dndhlIhBB"
    r"{FIjO;uooU)Q59=l+W2}e*M@U>KlFvA=VZlfN)2&?cER$ia@^9+(rg0HG$*f`*=<4Ih@EngDc<th<mqim>qNw&SYG}&3;YLjdNre@rqvD{C73p+bSiTpTraEcTXo@"
    r"$xJ5$l8lMb8xCk;ofmkWGl*|y9^=lV5Ag~I8&KW4k<nR~21>q`;==_q@NEuCIB~`VY~A^a{&0LqV&}M&*clr~j2j*%o-ZAhEcwGh4;j7W&uyMS+ygAgpi)b6U_%Dl"
    r"(k~*1cW*&q2@icYuZ@K9?Ig0Q64fj9q?8ZQ-1z2NVc^tA(Lv|!qQ!A#LK$Uu7rxsffTldh2QAz1iCwL@#SU}8UATt1U7Z3hcbDLgC*<%yev{b#V@6=*NGBbsIv{y_"
    r"W(nb07E6pTiy`Jd8j&RXTA&(vT#)?k1Lz+4#qg%eu&Y&K;jN_0teN{(c&Wh*itLM6ul2?3dbfPo{lZL|Et83wWn3UQ;d@El^l0)zT`{r$;9RuCPmPYsF^0BdI_%y!"
    r"J@&%HDrodRll}93Dp(t*0(aRsvLOaeY|DNvI7U5UXYR8g-}W@4+L}Y;gNZ@1_47S`Rni->tMV>CI%N>qC}&7!n;VlqYLB9K<f_Tl{^2O$%15g+nn;}&&1BW-QuHD!"
    r"pfdiUxW-0x!v2;mqTt_~MUIA*LZ=opmzt}}bZD*~yi}{n<~nMzSknq9c1UMgtqFXPR)Mu44y^q$M|S+S23&-<vlnGJ<V1Zlx@^f1xxjIV91d>g7goF>eLo8+r*GXr"
    r"bD<2oc<L1PTEz)yb}yb~hI?3FzyRa%muyP@3)WzP9Lp4cWLus-ro1iy{Nxiq`falx9XTx#<%w6*S<xo=vif3txoj<6s9i^=U97~_=LO=&o{zKokLz*rj*qnOvX8VV"
    r"));90+$_M9RoV9HRd9DpFzfbm4SV_s2A>G7z_mH6LBE>~n76(U6J77XzDPNsEc*%V5O<93SMsESs7$t_Ad~&*IS*Gc3K#tOk<C~II79DlB{uzyGW+jl8>o_z4ZV;A"
    r")Mjrx`s{Ed>CzZQZX9kvx2)2kiprPbU(}b8D!p}-&tM&uc8E&~PE4T==!K(3txf22twf2s%2~+@FBa9)(Z&W|`hlZ;7NBzCJ|;MK2MhN%1???O^tFNvy1DTSx-%z}"
    r"E!vmKD%fqn&1%C0D4WLwuj0ZAyXmZ0FoWHEY(6ZO%Y%0YcR=ZbI=J~P%GyT(_EG9pcp&>XyZXJ6>x7mTtJhy6HSVjC<^?FRTIFwHzpoK&P<spwO!67O#&e9$krwFS"
    r"Wg$q+7vWt)0{GqAkhQEfVx`SaFo-$BUc<}b^WBd4J?=Xe=D%aDPX~hWcui@}oL(S&^d3lhj)J$#<3WYq04OcgfL%i|=)&6#=x0tC+2pl}^mV3CD~USwyTlupxOk9n"
    r"X4X>vb8D%Aiw@*_Qij_9-xhSoly;Qew?~qE@T4TXwh=8~VT5(ELcFaPgJDl~*=Y;(S=*Nj;OTYw?8CA$`22<}zJKdm*6;3H)^v>zu#MA@w(jl+d#;Uw{mIF|XfzQB"
    r"RENPxnl_v<;6jIP^n}~n?brn01?<?#<<RDK0c&zRk--bsuo)>EnSg&cGKv$CjB#X)G;U1|Xf&<`ky-0N|L<VH`ribtmq<`vyAZka`ZVEvdxCHEYLcIw-^5dR>p=`$"
    r"^J4Q26`*GAd3Ipl1vX<(1YDc@3#!y~F|n==Q1_HI>oID>vU!`}%Gm|5z2pPG|3?=8f?AenY(uVS?7z+YFRA%RRl#Qlm_exbZxE{^3}%@|9BSY0hsc9^27AGU8nODU"
    r")vy6u<sJ^(BXVHT_xs%CZ3?2(4dJ49R^g(3Keh_POp--qmlIIAFfH+W+iuBupVyM_DJf{9s~xs$br!P6yF$FQiGz^VCP;_Dd=$Cji;4|L_(lGC{LSg7MGL|UL?bED"
    r"{82I=xtQ^l@yQZEPnET-f#y1PYz#sd!$DZ2dymO{h`|q^{%&N`JXR344Vp^xVXwFZ)%tjipjNLTU-bo(LqLTn6h9}5KA6BgNhDY%|D91j@sm+fE`T#LmI_X)#^5vU"
    r"D?ne48nabXi}~<A9v1l)K<6b*yj_mQ1kxi*TGq*ul`Co_Ij0toasAd%eug6SYI_PW<0s%3t^|L@ZiNd5KY}TdKLF=K$6tnd2sBz}!I~`|Fl76EZgz%($hIRwbQp;c"
    r"g`@=w_tvM1_B>BSOHcSnFtdjegV0{dwT@$``8)@#Bq|Rv%hlwKy|G0cURofXF*pii)}x3*GjGZwBjSYd6ms~dEcuSPDp`u#lTCqkkjYSj<D4GQ5#0rn-KW8VsvS^+"
    r"_zFrxCP7kLCqSE?f;Nr0u)^0Hrp^6C%ni9jgv>lf@_wX}^Dj&z{^RzL3V+>q?JO2-`!pL|bXN!Z-K}7HS|@lsy9PWkuLqlh^MOB=3zGatfZst~7#1y$tP8ruA3n$B"
    r"+qOILRk`2!(?zsIwR3<treH&Syq7>8Pe~w~kXT8Ol?pcPccMstdXs2x`a98U_*Rtr`LHPc@)_PUy#<K<!diaABR$FZfVspk;0!XkUWah~rihj<kRiu|^2n3zx#a$g"
    r"E=jRp6SgDLmD{KuD6U*-F4nqkD#o;CipTr%_!lEqx^&JT=BJa-C8;0!B&A<wBR2;CVbflWtiLPd2Nr(jiq(3#`x8F$PdEz@t@@)}osrMN^%Lsc`kk}5)3$2~rz??M"
    r"dsi!j`?Qq*=%kM1G1pXbvnLw~y{|%`_6lg$@d@I*Z!THgkVER;c_sNA*N9EODBymW86fVNW+txOW+HYtI71vI&gDN**@pzpVepm9Mf6pUg#OO{#*e))WcsXf0T~~H"
    r"FSba)XzVc7exATx8w4P)AqkE7Z<2WRQ4MwQQ%4_CLy`ja8mjXy6wMXg#C2~-XtQpT{>A42p0^d_Kh+wV)bW@FA=AOvuo<A=&JE8H@PWHg2^KullBzxFh>e_c#DWJd"
    r"A|A&fc6R8DOFyTRZ)egj*=_$wa-(P(5}xQp_*Pv)uI|3UH+#q7HAxJ3M(iLzp>Z)%91_pXZ5|cQ@m1q)X4SZrM>K@_YsK8uF9*=r&)4u9Wp%V1b&KxQH37>E&6sEU"
    r"R`C8i2c~q10%%>T2zsj*;qq<HKzFDZtAD_u5|%q+k*giC_^?7GoCC2{_KWfCvyEuOu5{WbEQ9V)+5pPts4?9w34$<BH@0TVF?`$VJiPkKS+J#c8{jJ&0tcRmPJb=J"
    r"r}T^PeW)k)rQ{~QGx7v+)?^kj>Sj-_?O8xpv|f}{R5tx}zoQhIXosu`pGMzaJdJ+)%K+{6>c(9h7gJ3Mt=I|E5(-;ZN+F#rc2v<658_Tidpur9lrsFuP2>NNewST%"
    r"BWmZc)+tZ1H#@cxe}9Wk9?GO83Z`VMU<&L!QBJB|)x-5S=Tn~kr>SU74gB$6KJ{^1j(B}<=UbXO^LjL`cxERb@Mo?NAcy1*Vc+AA5kEJnV(U(+V&S_T38{q~URSps"
    r"P0mO}i6RH|z~=?%vMu}3tm>C&R>UOoJZVgFe{>~zGH@lSz0=wyDE}<>d*5TMLopetw9cZ{m`u7dFOJyTEenNeRix1jL;T|H(^Ql2ER~Wy7k_;J9Inu73uudK{OYb@"
    r"GzvUHqcX4JeWz@}q-vnR<$-|FTR03o5{4nKdz4mL{aSF{6+*+(Fxc@(6D9|1z_6GAcr@-VytHyI@Dbg|Ba5}E5py%@PfZ&hX+fao=MM_be|kwD52T^oE*gSuebii@"
    r"pP=WZ8Em<x56^#_3V(l;hdZR2@XU)Na9OrDqI2pF-=%af?^EzLUgHHRf8W?*B%(70n`{8Yqp7MGW}}L2*wZhONtlAaow)@~4LOD;6!Xye11_j*c|3YR=`CuhHW%Dj"
    r"+JxU3`$%55k)swH-NO$vbFk4>2L(@EB=kR;G*q*q;RSDuQk>=|fNwbP(On~`SD^%DE-1oR|7pXa0}1d!M>=>aZwQ{wme7~xkhE;GHpsE7qVvjRT#;dU%*)1D+Va~-"
    r"y0rW#Q$Oo9<1e!j)+Ot}wsW)Lm#A6Lxzqs4cf~=&ta;ou2Xwj9vY)zCTRm~Ptn0|djNfwQd(TlroTu2l{$JDwnLm_N*p0o^JB;(QHc~P3da)%kHz~687FBAffHwde"
    r"-1PetZfM*yu9=60xZTV`TpB@gPXx#Dn@ZPHH(n=W7?_~OQzog2^6%Kgi+Az)IsVk8qgyfW&1ICq_i`$xdl=gmuZm|Dk}l6%wQv1iVd>)DW9ic6TI}pU#^q+6sY3sJ"
    r"^+nl@C(-Q%Cr~BdBs4Wl51X|z486#@qpNoMpw4B>(3NZgTFm_y-7)`<i<5OXmz>WL+s)>Px!7&4&&XkZ?N}(aX-yKgZMO`)YOXBpE*-~ArZ(VnctO;Xh0$1^O(o^j"
    r"SVeWHe#DkL%*L%kix8`!K5<*fSH6k+H~x-?5}u)%DVm&i5+XP4;d;F&INrPio?IRZ-?=IZ-d_^HVX+k~o3MlJQMRyhM<}duI15L2(8v`HSMd?ti&xv|%_~;5;#%I&"
    r"N8Wlyz(2aq@Mk^`y2o+hep!3S#E`JZNdr>G=1_QQ3S8|a3y*Jeg}ix*uxpZVvH7WTi_^<-NnLB{(z0g2`N;|wZrIlvlxy}6+ORecZOP3=PgSL&kEa-6liPQq$=`g@"
    r"<mf;&{zL$pb~hb8tuH~x>}jO%iHUgcn1I*lwTL(S>v^u3p*|A2VGBG4Twuv66u#mk(7VJDhB+|M`L`CdY`21TAEv^u`SOr9^n`NZDKKS5G<wEUl_>scN^a^gB_k~n"
    r"Nt1^Pc}{%;v{EVn+q{1QVfqhn-RB3WQ%iw!+;4zoxwYV6>q!t$nFS2rtHU}qJ18T=ca`~@vI8?*-%%Tpge6i(85tv2_h=n(%WvBMyNaA@?*9O^P7zr"
)
