// Reads features from standard input, gives them to ViSP, and prints its velocities.
//
// A line "generic D s1..sD L11..LD6", "point x y xd yd Z" or "line rho theta rho_d theta_d A B C D" is one feature.
// The first line of the output is the velocity of the generic ones, with EYEINHAND_CAMERA; the second that of points and
// lines, with EYETOHAND_L_cVe_eJe, the camera at rest and identities for cVe and eJe; "-" without any.
#include <iostream>
#include <list>
#include <string>
#include <visp3/core/vpColVector.h>
#include <visp3/core/vpMatrix.h>
#include <visp3/core/vpVelocityTwistMatrix.h>
#include <visp3/visual_features/vpFeatureLine.h>
#include <visp3/visual_features/vpFeaturePoint.h>
#include <visp3/visual_features/vpGenericFeature.h>
#include <visp3/vs/vpServo.h>

static void print(vpServo &task)
{
  if (task.featureList.empty()) {
    std::cout << "-" << std::endl;
    return;
  }
  vpColVector v = task.computeControlLaw();
  std::cout.precision(12);
  for (unsigned int i = 0; i < v.size(); i++)
    std::cout << v[i] << " ";
  std::cout << std::endl;
}

int main()
{
  vpServo generic, picture;
  generic.setServo(vpServo::EYEINHAND_CAMERA);
  picture.setServo(vpServo::EYETOHAND_L_cVe_eJe);
  picture.set_cVe(vpVelocityTwistMatrix());
  vpMatrix identity(6, 6);
  identity.eye();
  picture.set_eJe(identity);
  for (vpServo *task : {&generic, &picture}) {
    task->setInteractionMatrixType(vpServo::CURRENT);
    task->setLambda(0.5);
  }
  std::list<vpGenericFeature> rows;
  std::list<vpFeaturePoint> points;
  std::list<vpFeatureLine> lines;
  std::string kind;
  while (std::cin >> kind) {
    if (kind == "generic") {
      unsigned int d;
      std::cin >> d;
      vpColVector s(d);
      vpMatrix L(d, 6);
      for (unsigned int i = 0; i < d; i++)
        std::cin >> s[i];
      for (unsigned int i = 0; i < d; i++)
        for (unsigned int j = 0; j < 6; j++)
          std::cin >> L[i][j];
      rows.emplace_back(d);
      rows.back().set_s(s);
      rows.back().setInteractionMatrix(L);
      generic.addFeature(rows.back());
    } else if (kind == "point") {
      double x, y, xd, yd, Z;
      std::cin >> x >> y >> xd >> yd >> Z;
      points.emplace_back();
      points.back().set_xyZ(x, y, Z);
      points.emplace_back();
      points.back().set_xyZ(xd, yd, Z);
      picture.addFeature(*std::prev(points.end(), 2), points.back());
    } else {
      double rho, theta, rho_d, theta_d, A, B, C, D;
      std::cin >> rho >> theta >> rho_d >> theta_d >> A >> B >> C >> D;
      for (auto own : {std::make_pair(rho, theta), std::make_pair(rho_d, theta_d)}) {
        lines.emplace_back();
        lines.back().setRhoTheta(own.first, own.second);
        lines.back().setABCD(A, B, C, D);
      }
      picture.addFeature(*std::prev(lines.end(), 2), lines.back());
    }
  }
  print(generic);
  print(picture);
  generic.kill();
  picture.kill();
  return 0;
}
