"""The ANFIS friction model of the z axis as trained by `pneugantry.thesis.anfis_study`: three
memberships of five inputs, 243 rules.
"""

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
    return AnfisModel(
        centre.reshape(n, m),
        width.reshape(n, m),
        consequent.reshape(-1, n + 1),
        middle.copy(),
        half.copy(),
    )


PACKED = (
    r"c-kG3X*5;u!-j<>Q)ZEjQSu8>9D6@|KMzS6la%JDq(Nzr&|pfUl0--e(IAPGbIzWR5~)y1N`pe0R5Z|l_rKoz)3vT|*IIWnm&p6H4bn>E_CuTNhj{ZEfhx#41kLUx"
    r"@QYk=(CD26M;;~cYMvtC{6AJJO6EN(illQkCBu<r@5v5pdH8eZ2pJt!OKPgf!HW-S$>z%U<g=kc@>uz6QsLx#(sJBya$?16l5-SDJ#~3FQX?aoj{|VK)dP4_F&1V&"
    r"+6zat?m`1sbzyD#T%<6{3=Jypf$MJUgmXH6L)9~0g8i~t&T-ol=<cjf^qr`W^qD)3^tf0lzAi<C76+N3RdzDiUBJP+FKp0|QlL<EuLNoST!11UnxX;+6SPms61^Ug"
    r"3RlY?W5J<EDb?a%qL$~QoQG^MD*Iz0*1yOd)IXaHE?D&8DPCW21FIvT5_mCO>Qf+%Py=v-A*lUk0PK~t!O?PEHtL#!*jGivNx`5?ywJBxoY&gnc+BR2*mIf#di~uH"
    r"S(eby$XW_7c1=Uwm;D59ts=Cg&kHpVOh(CT4UyI5|24MX6vjy(V-Y*ksdO_fXHL*}KIed_A1P<C`Wf3%#)0`L$4&{Y+cOT;Zp=pE&GEvEk3Z4SY+och<c<c5+z@Y%"
    r"(B*Arva_rj9UuD{>vs~<E<R#fUssHgO5v1wxFUOVwINw`V1yOzljAgt=aP9=^En;E7NYUNK2j`B<pyJqaEhBf$&T}L`A(&&*eBHrXNzYdX^1P3MqWyAo)FVQ;hRNZ"
    r"v!Djr*be-b*(==rL@cO}0nDXWO+Y+D0}KUegTybIKx(W7;(|2Ut^=dRB{%;%_FwD}|84FNmyfM=e9{vsu4o*^V&N0XH{buTC)WLA?KKe@alws?NNFL=P4|;@)nU$a"
    r"UkZ0f-jn=vWe#8Q*#et$y43l|u!Hncpp#U$VZXCId`S5i{zt#tYe{}v|A75!*u<J<O(18+`*Mei?1;F7<4Mwg3@4W`mV5b7lhp9K&OM1zmXe|UB2T{pse~_({<AC*"
    r"5f;tTIRS?t>Pv>!OcCLdl|_uPT?%uAJ^XX8WiC<oZ~@mDFZ-J_PWIGLSJ+kYhfB~}Me0`oSQF~RU(0pkzYL9qdfykqqq9}em6tE!voQzYlY22RReS>)zcdo;I+wfj"
    r"IA-(xYwx1h<L{zH#qNAx^f=j)uh+<eB2|blHRm#IEx7*Fhve|LljI%EFrev!z|Q+e@t;3Z@Uzn_!OiFjCgw&HF!olWqqe)T(Uop&nCgBkVDJ@tQ~MjH+I|B|_3NYt"
    r"ow}$iI;SyB9bJ0<<#A|Id>j0a*aLfXBcRRn3h2Qb2tUYWE^&^h`9f5W!amfYgj-%bcW|ss^F|r@Zk`%!IX#toyu*rftA9jB_hpkp{9d#>+8eoSyb6OtO5uA88?=hA"
    r"5G?w;(7d~~TxHXc@DvUUm%eT%4L)C%Eq&HQF1|fLQss?Yx44N*x>ZlEs5`;^F1|?k{AW&XufD(<Uc1CvjUOcL?zzf+(`|zx58Cm(fS26Qs@Gid(*4AitQ5f+Ur3zm"
    r"J4`1#EN9;IuVA8%SYnUldsr+l2sHVMKu~KUzTP+<e;8{7w&Y!6`u5xhx7YyM?w1Su#LksXzt|*7#b2<wO`ouL5mM~o<u2-0MmH6wo{#zJs?(7^B}8GL30YuQ%&suI"
    r"z^=CbL8SMTayt~CLhlTWb{u@pnJsw9d0Va}cHB8EtS$5-HWwbG!zV6d_@~Pm9V<8N_uX!`ou5RPC6*CYKhoK}Cnwnacj3eYb^;f2Ihm{9`xm5?1@VooL41<oN}|;C"
    r"G@rV!hw}GKq@*v4nUFuljB~38=2!oR@l19G2FEsFJ5OlP>}m~KtXbi#ud<u|9uY^(*0Y2|Q(O4J!;knKR_d^$+6K+A=w-T;W8fyo7!K{&&rLp61ZOrMhI3W*!KP6X"
    r"DrYzszxXg0U&f|U3J2fNO9M6W`i{$R%H&kuWN|95DeQngs{K&(Po9sSeFMf;`SLrf7x48aWw7(WJs44%>m>h@6Hi2S;z=*>h_}JL;vmml3Gr(TZbYob|9NK9^4Zz+"
    r"EEPNa>-Rg-8r3({myj6zleR5=;l3?BIx`Uu>`22`f{DQS<aH|OOAfwM$icUMPNh<}chFTYw$mY7E<^w6sr<FzRQ~7T9Wdo;Kh)Ty$WL2e4gc2q@x}KS@{{p$cs1bx"
    r")W3EWAK!D0&RV;Uetlsr{hxgpJ(L{9+^D}ps((8R8P^hi;7ke6>urTERP117s5<Y^RR(L81@Tvx1oH+pWw1%97CJa=$J)ytNb9RkNLM>$NF(dQq_Sn^^oitR0&6s9"
    r")|EeD<Q}&&HEVBCdQBLY^|%~gJtYHo{b7Ok9y7;#4!M9s4Zks+-)Ee3>M1d``<A$F;w^Dm&TetY@?43woIKv59*jqR&Zcq496IflE$+GJuvFyOLp{dg@c=IeI#OvC"
    r"-Sa0IFFKWhAB+jdT*~iD#~wZ*eWsitJrKJ^YVgyH-uL}HF*n_k2@iVABqlszL}pD?w*tm-{*}17S1!I|jy0ZoXBti|m<QYk$Ke6NbEGf(G^HUkb*RtAI#jk_rUZ!m"
    r"DDkNt=V#Z<@G)n`vgDny?3lP{od3I+_1khDAL?nx7p>WjL-TF;758^|M_&(K_*WkKt9~T)>*7hHzF6|_;1BX~u@1jG{Sm42Vic74r*Lh-sa(EKBk6$^gP-a-^o9m&"
    r"x?@TkZDaM64nFpcDwwGX3}Z;RL~klIac?AxQtpv~x+~$qHNHIAp92S?HR0$R5u}RF4zfH-9?sF2$Xk`lsGde`I%)bmTJO+YI<n{qMV`<D)?xRlfG?}T`(Gx^Qv)-m"
    r"OsNPowxu%gZz9nAk_{exVVNv}V;-)G2fc?EvI8yoq7!T1RTtiIlpHm2lyn|c7blH#7CkyDg68!m@OWn(8INko^x;J?t9%~+MUn;g^{T@hjV<J%_)xO#h#dTTREtlG"
    r";wWOOHl18DhrTu1m0ouKF=gqh1A_J42(8^-XjtnjzreeXpC*@%&MrP6xadcrbHRz|f%QqDz2~IRW4{jF)UuWhTnqxU^2XEEx9pi>MSJG_@DzHu`2hHy_5_T7;)vco"
    r"c)`DJe8m?%nTq`DLxk-OMlfiS7V4O3C^RHb7ABf%pq5Tr@Hw@ORxdOJ4gR)_!fjhdWkNfq*JH&r*VIw}$@_s2a|7m*{UoN@IUDTLILH(?C4k~HIbgqqnCTc4GvH7h"
    r"=xz66ZLa5ume{C>L%-WeUU=F`MDE7oB{S_s^R&K##hdNX*{Y}f^2^Wo%<tyt!>b@6Q)~par>G-6d3`~Ck%3TiQVj_wB*KkbTj(|i18^aI1~W7=gCX-DV_om3GEBiB"
    r"Id;YhSZ9*JC0|J95=&~J)|y)0Q7cmLGcJSH-YJ6W%M{`9^Cuk177Bl}l-aa%yNKH$g6;hr!DgSH1~S$kVi(m<BJQ;Wkh;pb+)*-@>$>Scw)n)6N|O|1tv|D&Ozbav"
    r"=-@8{bsxz|7k9ht`klbvnb8EjC3pD=gLnBOYqFr|tT}RWRD}_h9i*TCLl8%Dpf+Dde#%qeyc)8&K93_LYjISF+jc~FTeXXL5f$pvJ4KV9-rNeKO^)*gNym9jt^nS-"
    r"Z-IQ==7EEeTfr-}FSK^VH+u0J5jb`?hxxH^A!(xJ!B~Bw*#~(vJNv_Jdat&O5obGqU5k%_o9iQ}=O^PRONH$~z56NX2pbPoN1l_V!<9fO=^OwX8FHWMH+Ge7CU-se"
    r"B3aI*3ckvzLT^Jov3zET%NYYL{_W<c(7yUOe|l0nFCSV6(}OHgsG$w&Rq#Q*_gG%1o#&%zW7L+gQ}9<ec75zKUN}`&E{pXjmwBoj<SQIUxuiXoM<!lJQ0aSfzU!$a"
    r"Uu3co#fhIIWupqRCipg-w>pkDS{Bb&q@_To^wGkP>?>&MQV}6P<DGDF)jPp%>=Za_y{-)TWW&GqC6Lva2D7hO!ugGd;PV4@uvys!+~{5pCRTOR9&+#LU%htV5q*Mj"
    r"3ic(9qX;I(QNmh&60>&?RnT9H?lNcR&jQ5IF`%!xjLLc$LdEXf2_n?mL4I2~8LK9PE++f<Sk(jkeCuRbYN{Xvrj#PP5e67nbqhwF-GY;@8I0}Lk!hIa!hF|@@Xu0f"
    r"xToI=TIC&v3!XPXxj99oN6a3$Ac^6AZsxg_i!dlwIm<T_;}AA_zMz+JkpH(di6`{a_>q0qvZA1H7<DBQe%YW0Z{oU8D?R|uT$uo`Oi87ql2Y(=hi>|}aW~!6Vunxc"
    r"dXGo9x(JugtVe(F3}K8YLs)8Pf}TAZKz>KA@Y@5|puFqyLY|+3P$5~2ECS+C{$wr8>Hc%<&w@P4Hz<!1CnsU+^LF8Vv7?1Jr>*E}_BsKVtrIHUrX$9r7a1i|e1XFf"
    r"G~xYtfr(QR@=g4abpC#H6K@p#a(N-P$=N0u3g0HNtO^&OFZ?Yr8aWOUE=&V1!4~uy!kpe`;SBD$dJ>CA7U91u?%^LA^l*h%Z9LHW5;(KQ5(N2bVA?m{V78(&)Cs>c"
    r"RN=x@Y_9PxJf9gYsKkY#KazFA^*8GTYRC$ykL^WvJ`BITWhqLWtt_N9D+{Yy0?_;mvB=FZALMFe(`P#anB*G)%=I=Sx&WMKR;!5+j0{Km&3*hG?LIzZI0)SquW<Qu"
    r"UY~ReutR(Ilyaw&D!J25ViYWmL_UpG(vUCKv`di+L!4A$G@5fMQRNaQWC?-bFDtb4;&;dd^}}sZibzK#5oP8-g?e$yXqUDCJ+5)E?|?R%)M$^+Exj-D)V(VfJi{ct"
    r"Gr}a1H34GftAmnR8;=A1bZyXHr$;m1I`nYB3{ZG~9wAd%gJ=4^!7bWNai4QW_|%X}u<74_V7}f>>7D!2Xp&Q5>?%~47b~(T#m`HaJJTV0r)`ZKj0a#v>rdzsJsOoB"
    r"JBY4kw!_YAYRIwp7ToGs18x54q2Za1=>F&HbZBuLUAcM@)3as~Q$k;&3fEj`Hmw?f!C61yM$JS>YbQXTS@kgb=tN{Zxdht&`~V}3)1hWx8uXer1hYyt(5nDNyxv$I"
    r"&o1@BW_5dDq0xr;xx_|l%;<CU#5YZpd8r?hd3^z6wIq{z_jwQ`q%M$5_PQ#0FRPaHn%$I~*Nv1MBjcUBPW{9(5@PU0+Wu6b+)`?-*BgA=^6%8_KjXoLo#*MItGNv4"
    r"nZs;&u$%rHUPly;{^GQ8*#fEfl8JPSg^{$(*jOsHJBpD>^-i)<TfEr1mD;AzM)_o$;|c>_^psDBaDCHJ_{N-fQqj)O(p8t<Vt9rMeq)NN=&$t(vFF_*PKz%bb$XcQ"
    r"AkLwWh*tjljG2?+_@rrm)WF@vR9H+KzNPyul@&Y=>^yUh7M;&#@VTd$n3Fr`MYgrX#`&L|+%<fpq9sPsx$TprnLd-HDxy?u?1#;OZBv5&ITtyJ{$=j9mLha(G~-);"
    r"Z-6)KXmaA!t87vIb#~^otK`8GqoEl$3Y^>RO2@Zs!D-X2`1DqF`q-y!p#Eta@ta>w;!d^fFUtnDTE38+AN;?Au@bm9Eu7V9-@(czq_Xv^hKa0`pP2_U-vIpt4d%~Y"
    r"U+_)p1A0f>VxxnCfv1~-Xi19&E|fP=2e#g)#+)|5H_daQ^TLww*(<(dF}EtE<pE;p{4s6VUoS1ZJWoj^vRx$(yprlPaPWxJ!v{0Plgkf_^xr=tA~yt(*L<aHyeY?O"
    r"6r3UVEWXTrNuy!T6bbv+sFfMjr@~%n|4PJ9R|TH4--6TwI*iirLeNhv1U{WpuqB1-!Hvl!WMD=uw|u5G8MbR0IRi~#(z<lXf;2yuCi8hhQ<*&alr{_lH;2Oa5r^UU"
    r"ZE<8xoGPbKH<`@cF`1mZAQK-&sgZJNYw7g4O7y9XqnXa@ij2-%p7P#t0obIRV#BZP0I8uGoExRiHC#W1zqNc#D#`9K=dP?LWP}+jUt-2KAS<HBvXb!lSchxxkD(p6"
    r"i<p{7M@AW+NB@_RNvsa4Cd57N%*OCsuCODU^9<``qQ{R%&L@?byKZ$vyQu~H?zRORYM)Q|VLs&7?K5$0Uw<su&K*mLcE`dzemmz?#N$8K#Sw+!FR9Fxn#9Z3nuLv~"
    r"9R1dP9QkkI6fk|E8~Elb4`v)41p+Tk2CUL0&}w=c|MYt=%@{c{4OX)lqGvum^?e3`4O9`Ao$BcGIyu~mv{PK<Aj>FU8jC0cRp!LZI^uMq1?y*N$p-GvCz4nCkVY!n"
    r"khGpgy3aHtSMD_<Upm|&3Px7J?4yA$DqnYVKL7QgSt{>Q!`KU4^~LutUMrOl_uLZc1wDhV)@^X5(HMmL97ml?6`{0LowT!9NN%S6$T6R;5vJB0Ny)8nF|yO)u-Ix8"
    r"%2cBRdYSB|#ojK@@Ap99(F3P;Qm~~@3T^gEV6DY$H15L;yt>p4+gCgv3m=$|Q6BG{&m51#kFVZOT>GO(Wz?t>hNK2zJ1w1>IDHIRW<C`ROqvI_JXQo}3={z$Y66}f"
    r"D+PnK3UDY+g*-pWpFC2%kX-FoN}M&|Nv(|KF7YqQ*~+e)NY}U;-P>8ke5~|x*&gu`YU+N3?sHh!<;y^mFBG)d=!C{INpK6TLY}NS$xPjm#rzt32INrD<gKl`u3<C2"
    r"u%T<5WflvZWq!I@#PSc@glFe%(D&+gIJvkH&MkWY$4`*Kfpj}Wn>`dS*J4E(pONIlF&Bwx^EQ$BOl9Y?S0(J&07dd*{s@ab9APD|XyPj$PbO!0u`RcL5UqLHtcqt2"
    r"yWaCX;T1N4?D%XY%6;4`a-aS~a((o7iCce;s6NIG8`-dd%}{tlcqt6Cvy+BcS(}7d(ENyeS?k93T*)T%+z+v;w+^u;RU<^W>H}isn-fmSwVku;f=e8`6)rd~ENY*<"
    r"zw(Du&xHn{GwM9>kGc#Z1}=efYVqKUJw{Mkfxu{8H0XD92kScBfcf=PAZ1GlsQzFnO8Wg%lv4U#@+zZWB6*lEnq@Z!JE^vj1=;PyZ_{CRfBq25=iVd|PCX<Gyxm#R"
    r"^V7tUCCO~&(`5FotvsnXs)<-SDgx&=4LPsEU9o)6IoSHMADnN;w%|o3myrvTg8J=`BBt&LVtke(Kg`I*SARAlzb-+a-7HazsRc6S;*r9wV`%KfojA2HM7q(wh<ZM;"
    r"h$<u1oLyv;WVYr(^g@3d@?IZ^E+#KQwclo={a8CHA67$wRc=VnZ3wpd|AprZywPH(y~y@yy3@qRR*rvKiyh|%lsHPlbRExr=ySS1;Q>&LDgxrcE8s}f6;Nas50qEp"
    r"gk9Szur(+FWUu!Icjdgmi#=ySeQzn)e|#q%m}o1dHWyKW%Zeyf=h@EnoifR0yCjs*9F9ttFGIQemZI2gPRQHqC6dt^XxAhU)TT2E&DE1b$sr3-#<y71CtVAC)J{=u"
    r"a4j<#tYy}m_H(u<S-~_eN<_vjub{?n4HSD(167nif(usUp&GMm(DauIO8%1p2Unbc%F{jm*Es{p$ziT?|6691lI!xv_E^pS1+(PjOk5ofs6*em<Nn`u*(W&tALg<b"
    r">;"
)
